"""Non-linear parameters of all terms of a model, and how friction changes sign beside them, searched together at last.

A term's parameters that were searched while another's were rough have stood in for it, and a friction's sign that was
chosen without it for both. So all are moved together by Gauss and Newton's steps with Levenberg's damping; what is
linear is projected out (variable projection: Golub, Pereyra 1973; Kaufman 1975), and after each step the predictions
that columns are made of are made again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.prediction import Prediction, predicted
from excite.diagnosis.budget.refine import Beside
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.friction_sign import WIDTHS, SignChange
from excite.diagnosis.equations.own_columns import BREAKAWAY_BOUNDS, COULOMB, WIDTH_BOUNDS, own_signals, own_terms

# Steps at most, step of the derivatives and longest step, both relative, and tries of a step.
_STEPS, _SMALL, _LONGEST, _TRIES = 10, 1e-3, 0.5, 4
# Steps on the same predictions, and how often new ones may be no better before the search ends.
_INNER, _PATIENCE = 3, 3
# Nats by which the last step has to be better.
_DONE = 0.3
# Nats that a parameter of a richer form is worth; as in the search of richer forms.
_RICHER = 3.0


# What has no term: a joint's sign change of friction, and how long before the velocity all change; bounds of that [s].
_SIGN, _LEAD, _LEADS = -1, -2, (2e-4, 0.02)


class Knob(NamedTuple):
    """A number that is moved.

    Attributes:
        term: index of the term that has it; or of a joint's sign change of friction, or the lead of all of them.
        joint: index of the joint.
        place: index in the term's ``theta``.
        low: least value.
        high: greatest.
    """

    term: int
    joint: int
    place: int
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class State:
    """Terms at some parameters, fitted together.

    Attributes:
        full: what every model begins with, at its friction's sign changes.
        rows: what all models have in common.
        terms: the terms.
        model: fitted.
        share: ``(n_joints,)`` effective part of the rows.
    """

    full: Baseline
    rows: Rows
    terms: tuple[Term, ...]
    model: Model
    share: Array

    @classmethod
    def fitted(
        cls,
        full: Baseline,
        rows: Rows,
        terms: Sequence[Term],
        share: Array | None = None,
        weight: Array | None = None,
    ) -> State:
        """Fit terms.

        Args:
            full: what every model begins with.
            rows: what all models have in common.
            terms: the terms.
            share: ``(n_joints,)`` effective part of the rows; None for that of what is left here.
            weight: where the joints' weights begin.
        """
        model = fit(Design(rows, tuple(terms)), range(len(terms)), weight, left_out=False)
        return cls(full, rows, tuple(terms), model, model.share if share is None else share)

    def changed(self, terms: Sequence[Term], full: Baseline | None = None, rows: Rows | None = None) -> State:
        """With other terms, or other sign changes of friction."""
        full, rows = full or self.full, rows or self.rows
        return State.fitted(full, rows, terms, self.share, self.model.weight)

    @cached_property
    def loss(self) -> float:
        """Nats from saying nothing, less a constant: smaller is better."""
        grams = self.model.design.fitted
        power = self.model.power(grams.together)[0]
        return float(0.5 * grams.count.sum() * (self.share * np.log(power)).sum())

    @cached_property
    def prediction(self) -> Prediction:
        """Torques of the model."""
        return predicted(self.full, self.model)

    def context(self, k: int) -> Context:
        """What a term's columns are made of."""
        return self.prediction.without(k)


@dataclass(frozen=True, eq=False)
class Polisher:
    """Searches the non-linear parameters of a model's terms together.

    Attributes:
        library: makes what the model begins with.
    """

    library: Library

    def polished(self, full: Baseline, rows: Rows, terms: Sequence[Term]) -> State:
        """The terms at their best parameters together, each in the plainest form that says as much.

        Args:
            full: what every model begins with, fitted.
            rows: weighted rows of what is modelled.
            terms: the terms.
        """
        state = State.fitted(full, rows, terms)
        if not self._knobs(state):
            return state
        state = self._searched(state)
        state = State.fitted(state.full, state.rows, state.terms, weight=state.model.weight)
        state = self._in_forms(state)
        rubbing = sorted({knob.joint for knob in self._knobs(state) if knob.term == _SIGN})
        signs = state.full.signs
        for j in rubbing:
            state = self._plain_sign(state, j)
        if any(knob.term == _LEAD for knob in self._knobs(state)):
            state = self._plainer(state, state.full.signs, 0.0)
        return state if state.full.signs == signs else self._in_forms(state)

    def _in_forms(self, state: State) -> State:
        """Each term in the plainest form that says as much, and the one of highest order of those."""
        for k, term in enumerate(state.terms):
            if not term.started:
                for other in _other_forms(term.effect):
                    state = self._in_form(state, k, other)
        return state

    def _in_form(self, state: State, k: int, effect: Effect) -> State:
        """A term in another form, where that says as much with less, or more with as much."""
        term = state.terms[k]
        theta = term.theta[: len(effect.searched)]
        made = TermMaker(state.context(k), state.full.strict).make(effect, term.location, theta)
        if made is None:
            return state
        begun = state.changed((*state.terms[:k], made, *state.terms[k + 1 :]))
        if not _can_be(begun, k):
            return state
        found, spared = self._searched(begun), term.n_parameters - made.n_parameters
        if not _can_be(state, k):
            return found
        return found if found.loss < state.loss + (_RICHER + spared if spared > 0 else 0.0) else state

    def _plain_sign(self, state: State, j: int) -> State:
        """A joint's friction without the bristles that it may have been thought to have for want of a term."""
        if not state.full.signs[j].bent:
            return state
        signs = list(state.full.signs)
        signs[j] = SignChange(WIDTHS[len(WIDTHS) // 2])
        return self._plainer(state, signs, state.full.samples.lead)

    def _plainer(self, state: State, signs: Sequence[SignChange], lead: float) -> State:
        """With plainer sign changes of friction, where these say as much."""
        new = self._columns(state, signs, lead, [term.theta for term in state.terms])
        if new is None:
            return state
        found = self._searched(state.changed(new[2], new[0], new[1]))
        return found if found.loss < state.loss + _RICHER else state

    def _searched(self, state: State) -> State:
        """Steps and new predictions by turns, until neither gains anything.

        A gear's own torque goes round: what it takes from the bodies behind it changes them, and they its load. The
        turns may swing about where they end, so Anderson's mixing (1965) of the last two bodies is what comes next.
        """
        knobs, n = self._knobs(state), state.rows.shared.shape[2]
        if not knobs:
            return state
        gears = any(term.effect.moves for term in state.terms if not term.effect.is_body)
        state = self._remade(state, state.prediction) if gears else state
        best, worse, x = state, 0, state.model.x[:n]
        last: tuple[Array, Array] | None = None
        for _ in range(_STEPS):
            found = self._stepped(state, knobs)
            there = found.model.x[:n]
            made = self._remade(found, found.prediction)
            gained = best.loss - made.loss
            worse = 0 if gained > _DONE else worse + (2 if gained > -_DONE else 1)
            best = made if gained > 0.0 else best
            if worse >= (_PATIENCE if gears else 1):
                break
            mixed = there if last is None else _mixed(found.model.normal[:n, :n], there, there - x, *last)
            last, x, state = (there, there - x), mixed, made
            if mixed is not there:
                moved = replace(found.model, x=np.concatenate([mixed, found.model.x[n:]]))
                state = self._remade(found, predicted(found.full, moved))
        return best

    def _stepped(self, state: State, knobs: Sequence[Knob]) -> State:
        """The best at the predictions as they are."""
        damping = 1e-2
        for _ in range(_INNER):
            found, damping = self._step(state, knobs, damping)
            if found is None:
                break
            gained, state = state.loss - found.loss, found
            if gained < _DONE:
                break
        return state

    def _remade(self, state: State, prediction: Prediction) -> State:
        """All terms made of predictions, at the same parameters or at those that say the same, whatever fits better."""
        terms, carried = list(state.terms), list(state.terms)
        for k, term in enumerate(terms):
            if term.started or term.effect.is_body:
                continue
            context = prediction.without(k)
            maker = TermMaker(context, state.full.strict)
            theta = term.effect.carried_over(term.context, context, term.location, term.theta)
            terms[k] = _made(maker, term, term.theta) or term
            carried[k] = terms[k] if theta == term.theta else _made(maker, term, theta) or term
        here = state.changed(terms)
        if all(a is b for a, b in zip(terms, carried, strict=True)):
            return here
        return min(here, state.changed(carried), key=lambda item: item.loss)

    def _step(self, state: State, knobs: Sequence[Knob], damping: float) -> tuple[State | None, float]:
        """One step at the predictions as they are, and its damping; None where none is better."""
        information, slope = self._equations(state, knobs)
        here = np.log([_value(state, knob) for knob in knobs])
        low, high = (np.log([getattr(knob, side) for knob in knobs]) for side in ("low", "high"))
        for _ in range(_TRIES):
            lifted = information + np.diag(damping * np.diag(information) + 1e-9)
            step = np.clip(np.linalg.solve(lifted, slope), -_LONGEST, _LONGEST)
            found = self._at(state, knobs, np.exp(np.clip(here + step, low, high)))
            if found is not None and found.loss < state.loss:
                return found, max(0.1 * damping, 1e-4)
            damping = max(10.0 * damping, 0.1)
        return None, damping

    def _equations(self, state: State, knobs: Sequence[Knob]) -> tuple[Array, Array]:
        """Information about the knobs' logarithms beside all that is linear, and its right side."""
        model, use = state.model, state.rows.block >= 0
        beside = Beside.of(model)
        moved = [self._moved(state, knob) for knob in knobs]
        n = len(knobs)
        cross, inner, slope = np.zeros((model.layout.size, n)), np.zeros((n, n)), np.zeros(n)
        for j in range(state.rows.n_joints):
            d = np.column_stack([change[j] if j in change else np.zeros(int(use.sum())) for change in moved])
            if d.any():
                w = model.weight[j]
                cross[model.layout.numbers[j]] += w * (beside.columns(j) @ d)
                inner += w * d.T @ d
                slope += w * (d.T @ model.residual[j][use])
        return inner - cross.T @ (beside.inverse @ cross), slope

    def _moved(self, state: State, knob: Knob) -> dict[int, Array]:
        """Change of what is fitted per unit of a knob's logarithm, by joint, at the rows that are fitted."""
        value, use = _value(state, knob), state.rows.block >= 0
        way = _SMALL if value * (1.0 + _SMALL) <= knob.high else -_SMALL
        new = self._columns_at(state, [knob], [value * (1.0 + way)])
        change: dict[int, Array] = {}
        if new is None:
            return change
        _, rows, terms = new
        n, x = state.rows.shared.shape[2], state.model.x
        for j, (old, own) in enumerate(zip(state.rows.own, rows.own, strict=True)):
            if own is not old:
                number = state.model.layout.numbers[j][n : n + own.shape[1]]
                change[j] = (own - old) @ x[number]
        for k, (old_term, term) in enumerate(zip(state.terms, terms, strict=True)):
            if term is old_term or term.kept != old_term.kept:
                continue
            before = state.model.parameters(k)
            # The same parameters in the units of the new columns.
            after = before if term.known else before * old_term.scale / term.scale
            for j, block in term.columns.items():
                old_rows = old_term.columns[j] @ before if j in old_term.columns else 0.0
                change[j] = change.get(j, 0.0) + block @ after - old_rows
        return {j: values[use] / np.log1p(way) for j, values in change.items()}

    def _at(self, state: State, knobs: Sequence[Knob], values: Array) -> State | None:
        """Fitted at other values of the knobs; None where they cannot be."""
        new = self._columns_at(state, knobs, values.tolist())
        if new is None:
            return None
        full, rows, terms = new
        found = state.changed(terms, full, rows)
        return found if all(_can_be(found, knob.term) for knob in knobs if knob.term >= 0) else None

    def _columns_at(
        self, state: State, knobs: Sequence[Knob], values: Sequence[float]
    ) -> tuple[Baseline, Rows, list[Term]] | None:
        """Baseline, rows and terms at other values of the knobs; what does not change is the same object."""
        signs, thetas = list(state.full.signs), [term.theta for term in state.terms]
        lead = state.full.samples.lead
        for knob, value in zip(knobs, values, strict=True):
            if knob.term == _LEAD:
                lead = value
            elif knob.term == _SIGN:
                sign = signs[knob.joint]
                signs[knob.joint] = sign._replace(**{_number_of(sign): value})
            else:
                theta = thetas[knob.term]
                thetas[knob.term] = (*theta[: knob.place], value, *theta[knob.place + 1 :])
        return self._columns(state, signs, lead, thetas)

    def _columns(
        self, state: State, signs: Sequence[SignChange], lead: float, thetas: Sequence[Theta]
    ) -> tuple[Baseline, Rows, list[Term]] | None:
        full, rows, terms = state.full, state.rows, list(state.terms)
        led = lead != full.samples.lead
        turned = [j for j, sign in enumerate(signs) if led or sign != full.signs[j]]
        begun: dict[tuple[str, str], Term] = {}
        if turned:
            full = full.with_signs(signs, lead)
            own = list(rows.own)
            for j in turned:
                columns = own_signals(full.samples, own_terms(self.library.modelled), j, signs[j])
                if columns.shape[1]:
                    own[j] = full.samples.rows(columns) * full.strict[j][:, None]
            rows = replace(rows, own=tuple(own))
            begun = {t.key: t for t in self.library.begun(TermMaker(Context(full), full.strict))}
        for k, term in enumerate(terms):
            rubs = term.own in turned and (term.effect.friction or term.effect.term is COULOMB)
            if thetas[k] == term.theta and not rubs:
                continue
            if term.started:
                terms[k] = begun.get(term.key, term) if not term.effect.along else term
                continue
            context = term.context
            if turned:
                context = Context(replace(context.baseline, signs=tuple(signs), samples=full.samples))
            made = _made(TermMaker(context, full.strict), term, thetas[k])
            if made is None:
                return None
            terms[k] = made
        return full, rows, terms

    def _knobs(self, state: State) -> list[Knob]:
        """All that may be moved."""
        knobs = []
        rubbing: set[int] = set()
        for k, term in enumerate(state.terms):
            if term.started or term.effect.is_body or term.effect.nameless:
                continue
            knobs += [Knob(k, -1, i, p.low, p.high) for i, p in enumerate(term.effect.searched)]
            if term.effect.friction and term.own is not None:
                rubbing.add(term.own)
        for j in sorted(rubbing):
            bounds = BREAKAWAY_BOUNDS if state.full.signs[j].bent else WIDTH_BOUNDS
            knobs.append(Knob(_SIGN, j, 0, *bounds))
        if rubbing and state.full.samples.lead > 0.0:
            knobs.append(Knob(_LEAD, -1, 0, *_LEADS))
        return knobs


def _mixed(metric: Array, there: Array, change: Array, before: Array, change_before: Array) -> Array:
    """Where two steps ``change`` towards ``there`` and ``before`` cancel, as far as one of them tells (Anderson 1965)."""
    turn = change - change_before
    size = float(turn @ metric @ turn)
    share = float(turn @ metric @ change) / size if size > 0.0 else 0.0
    return there - np.clip(share, -1.0, 0.8) * (there - before)


def _value(state: State, knob: Knob) -> float:
    if knob.term >= 0:
        return state.terms[knob.term].theta[knob.place]
    if knob.term == _LEAD:
        return state.full.samples.lead
    sign = state.full.signs[knob.joint]
    return float(getattr(sign, _number_of(sign)))


def _number_of(sign: SignChange) -> str:
    return "breakaway" if sign.bent else "width"


def _made(maker: TermMaker, like: Term, theta: Theta) -> Term | None:
    whole = len(like.kept) == len(like.effect.linear)
    return maker.make(like.effect, like.location, theta, None if whole else like.kept)


def _can_be(state: State, k: int) -> bool:
    """Whether a fitted term is physical."""
    term = state.terms[k]
    return term.known or term.effect.admissible(
        term.context, term.location, term.theta, term.beta(state.model.parameters(k))
    )


def _other_forms(effect: Effect) -> list[Effect]:
    """The form with what a first order leaves out, and the plain one of which an effect is a richer form."""
    others = [] if effect.closer is None else [effect.closer]
    plain = EFFECTS.get(effect.name)
    if plain is None or type(plain) is type(effect):
        return others
    if effect.closer is None and plain.closer is not None:
        plain = plain.closer
    return [*others, plain] if effect.searched[: len(plain.searched)] == plain.searched else others
