"""Non-linear parameters of all terms of a model of the gap, searched together at last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.evidence import merit
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.refine import RICHER
from excite.diagnosis.budget.search import Prediction, Search, predicted, torque_of
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange, width_bounds
from excite.diagnosis.equations.noise_floor import noisy_motion
from excite.diagnosis.equations.own_columns import BREAKAWAY_BOUNDS, COULOMB, own_rows, own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.progress import step
from excite.regressor.kernels import inverse_dynamics

# What is moved when a model's non-linear parameters are searched together: terms' own, and friction's sign
# changes.

# What has no term: a joint's sign change of friction.
SIGN = -1


class Knob(NamedTuple):
    """A number that is moved.

    Attributes:
        term: index of the term that has it; or of a joint's sign change of friction.
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

    def value(self, state: State) -> float:
        """What it is."""
        if self.term >= 0:
            return state.terms[self.term].theta[self.place]
        sign = state.full.signs[self.joint]
        return float(getattr(sign, number_of(sign)))


class Columns(NamedTuple):
    """What a model is fitted of; what does not change is the same object.

    Attributes:
        full: what every model begins with.
        rows: what all models have in common.
        terms: the terms.
    """

    full: Baseline
    rows: Rows
    terms: list[Term]


def number_of(sign: SignChange) -> str:
    """Which number of a sign change is searched."""
    return "breakaway" if sign.bent else "width"


def knobs_of(state: State, joint: int | None = None) -> list[Knob]:
    """All that may be moved, or what is of one joint alone."""
    knobs = []
    rubbing: set[int] = set()
    for k, term in enumerate(state.terms):
        if term.started or term.effect.is_body or term.effect.nameless:
            continue
        if joint is not None and term.own != joint:
            continue
        knobs += [Knob(k, -1, i, p.low, p.high) for i, p in enumerate(term.effect.searched)]
        if term.effect.friction and term.own is not None:
            rubbing.add(term.own)
    for j in sorted(rubbing):
        sign = state.full.signs[j]
        widths = width_bounds(state.full.samples, j, straight=sign.straight)
        bounds = BREAKAWAY_BOUNDS if sign.bent else widths
        knobs.append(Knob(SIGN, j, 0, *bounds))
    return knobs


@dataclass(frozen=True, eq=False)
class Moved:
    """Makes columns at other values of what is moved.

    Attributes:
        library: makes what the model begins with.
    """

    library: Library

    def at(self, state: State, knobs: Sequence[Knob], values: Sequence[float]) -> Columns | None:
        """Baseline, rows and terms at other values of the knobs; what does not change is the same object."""
        signs, thetas = list(state.full.signs), [term.theta for term in state.terms]
        for knob, value in zip(knobs, values, strict=True):
            if knob.term == SIGN:
                sign = signs[knob.joint]
                signs[knob.joint] = sign.at(number_of(sign), value)
            else:
                theta = thetas[knob.term]
                thetas[knob.term] = (*theta[: knob.place], value, *theta[knob.place + 1 :])
        return self.with_signs(state, signs, thetas)

    def with_signs(
        self, state: State, signs: Sequence[SignChange], thetas: Sequence[Theta]
    ) -> Columns | None:
        """The same at sign changes of friction and all terms' parameters."""
        full, rows, terms = state.full, state.rows, list(state.terms)
        turned = [j for j, sign in enumerate(signs) if sign != full.signs[j]]
        begun: dict[tuple[str, str], Term] = {}
        if turned:
            full = full.with_signs(signs)
            own = list(rows.own)
            for j in turned:
                drive = own_rows(full.samples, own_terms(self.library.modelled), j, [signs[j]])[0]
                own[j] = drive * full.strict[j][:, None]
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
            made = made_like(TermMaker(context, full.strict), term, thetas[k])
            if made is None:
                return None
            terms[k] = made
        return Columns(full, rows, terms)


# Terms at some non-linear parameters, fitted together with all that is linear.


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

    def can_be(self, k: int) -> bool:
        """Whether a fitted term is physical."""
        term = self.terms[k]
        return term.admissible(term.context, self.model.parameters(k))

    def remade(self, prediction: Prediction, joint: int | None = None) -> State:
        """Terms made of predictions, at the same parameters or at those that say the same, whatever fits better.

        Args:
            prediction: what the columns are made of.
            joint: index of the one whose own terms are made again; None for all terms.
        """
        terms, carried = list(self.terms), list(self.terms)
        for k, term in enumerate(terms):
            if term.started or term.effect.is_body or (joint is not None and term.own != joint):
                continue
            context = prediction.without(k)
            maker = TermMaker(context, self.full.strict)
            theta = term.effect.carried_over(term.context, context, term.location, term.theta)
            terms[k] = made_like(maker, term, term.theta) or term
            carried[k] = terms[k] if theta == term.theta else made_like(maker, term, theta) or term
        here = self.changed(terms)
        if all(a is b for a, b in zip(terms, carried, strict=True)):
            return here
        return min(here, self.changed(carried), key=lambda state: state.loss)


def made_like(maker: TermMaker, like: Term, theta: Theta) -> Term | None:
    """A term at other non-linear parameters, with the same of its linear ones."""
    whole = len(like.kept) == len(like.effect.linear)
    return maker.make(like.effect, like.location, theta, None if whole else like.kept)


# Gauss and Newton's steps of all non-linear parameters together, what is linear projected out.

# Turns at most, step of the derivatives and longest step, both relative, and tries of a step. A gear that turns gravity
# with it takes eight turns; ripples are the reason for so small a step of the derivatives.
_STEPS, _SMALL, _LONGEST, _TRIES = 10, 1e-3, 0.5, 4
# Steps on the same predictions, and how often new ones may be no better before the search ends: that gear's third turn
# is worse than its second.
_INNER, _PATIENCE = 3, 3
# Nats by which a turn has to be better for another one.
_DONE = 0.3


@dataclass(frozen=True, eq=False)
class Steps:
    """Searches non-linear parameters from where they are.

    Attributes:
        moved: makes columns at other values.
    """

    moved: Moved

    def searched(self, state: State, joint: int | None = None) -> State:
        """Steps and new predictions by turns, until neither gains anything.

        A gear's own torque goes round: what it takes from the bodies behind it changes them, and they its load. The
        turns may swing about where they end, so Anderson's mixing (1965) of the last two bodies is what comes next.

        Args:
            state: where to begin.
            joint: index of the one whose terms' parameters are searched; None for all.
        """
        knobs, n = knobs_of(state, joint), state.rows.shared.shape[2]
        if not knobs:
            return state
        own = [term for term in state.terms if joint is None or term.own == joint]
        gears = any(term.effect.moves for term in own if not term.effect.is_body)
        state = state.remade(state.prediction, joint) if gears else state
        best, worse, x = state, 0, state.model.x[:n]
        last: tuple[Array, Array] | None = None
        for _ in range(_STEPS):
            found = self._stepped(state, knobs)
            there = found.model.x[:n]
            made = found.remade(found.prediction, joint)
            gained = best.loss - made.loss
            worse = 0 if gained > _DONE else worse + (2 if gained > -_DONE else 1)
            best = made if gained > 0.0 else best
            if worse >= (_PATIENCE if gears else 1):
                break
            upcoming = there if last is None else mixed(found.model.normal[:n, :n], there, there - x, *last)
            last, x, state = (there, there - x), upcoming, made
            if upcoming is not there:
                moved = replace(found.model, x=np.concatenate([upcoming, found.model.x[n:]]))
                state = found.remade(predicted(found.full, moved), joint)
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

    def _step(self, state: State, knobs: Sequence[Knob], damping: float) -> tuple[State | None, float]:
        """One step at the predictions as they are, and its damping; None where none is better."""
        information, slope = self._equations(state, knobs)
        here = np.log([knob.value(state) for knob in knobs])
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
        moved = [self._change(state, knob) for knob in knobs]
        n = len(knobs)
        cross, inner, slope = np.zeros((model.layout.size, n)), np.zeros((n, n)), np.zeros(n)
        for j in range(state.rows.n_joints):
            d = np.column_stack([change[j] if j in change else np.zeros(int(use.sum())) for change in moved])
            if d.any():
                w = model.weight[j]
                cross[model.layout.numbers[j]] += w * (beside.joint(j).columns @ d)
                inner += w * d.T @ d
                slope += w * (d.T @ model.residual[j][use])
        return inner - cross.T @ (beside.inverse @ cross), slope

    def _change(self, state: State, knob: Knob) -> dict[int, Array]:
        """Change of what is fitted per unit of a knob's logarithm, by joint, at the rows that are fitted."""
        value, use = knob.value(state), state.rows.block >= 0
        way = _SMALL if value * (1.0 + _SMALL) <= knob.high else -_SMALL
        new = self.moved.at(state, [knob], [value * (1.0 + way)])
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
        new = self.moved.at(state, knobs, values.tolist())
        if new is None:
            return None
        full, rows, terms = new
        found = state.changed(terms, full, rows)
        return found if all(found.can_be(knob.term) for knob in knobs if knob.term >= 0) else None


def mixed(metric: Array, there: Array, change: Array, before: Array, change_before: Array) -> Array:
    """Between ``there`` and ``before``, where the steps that led to them would cancel (Anderson 1965)."""
    turn = change - change_before
    size = float(turn @ metric @ turn)
    share = float(turn @ metric @ change) / size if size > 0.0 else 0.0
    return there - np.clip(share, -1.0, 0.8) * (there - before)


# Terms that only damp the noise of the measured motion, taken out again.
#
# Predicted torques follow measured positions, and so does what a term makes of them: both have the same
# noise. A term that damps its own motion where noise is strong, a soft gear or a body that takes inertia
# away, then predicts torques better without being there: the attenuation of errors in variables (Carroll et
# al. 2006, chapter 3). With the motion moved by as much noise again and all parameters held, what a model
# leaves grows by the part that is noise's; by as much less as it grows with a term than without, the term has
# gained nothing.

# Standard deviations that noise may stray by. Of six simulated records of a Jaco2 without any gap one kept a soft gear
# without them, or not, as the draw had it; with them none does. Other numbers were not tried.
_DEVIATIONS = 2.0


@step("allow for noise of positions")
def without_noise(search: Search, full: Baseline, sigma: Array, rng: np.random.Generator) -> None:
    """Drop the terms of a search's model whose gain is not worth its price once that from noise is taken off.

    Args:
        search: settled; the weakest of its terms are judged first.
        full: what every model begins with, fitted.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        rng: source of the noise.
    """
    terms = search.design.terms
    judged = [k for k in search.model.chosen if not (terms[k].started or terms[k].effect.timing)]
    if not judged:
        return
    moved = noisy_motion(full.samples, sigma, rng)
    noise = _noise(full, search.model, moved)
    for k in sorted(judged, key=search.model.taken_by):
        others = [i for i in search.model.chosen if i != k]
        without = fit(search.design, others, search.model.weight)
        more = _noise(full, without, moved)
        quieter = _quieter(without, search.model, _likely(more - noise))
        if not merit(quieter, search.model, terms[k], search.candidates).passes:
            search.model, noise = without, more
            search.merits.pop(k, None)
            search.rivals.pop(k, None)


def _likely(drawn: Array) -> Array:
    """What noise may well have changed in all blocks, ``(n_joints,)``, from one draw by block ``(n_blocks, n_joints)``.

    The record's own noise strays from the mean as far as the drawn noise does: two standard deviations of both.
    """
    return np.asarray(drawn.sum(axis=0) + _DEVIATIONS * np.sqrt(2.0 * len(drawn)) * drawn.std(axis=0))


def _quieter(without: Model, with_it: Model, noise: Array) -> Model:
    """A model less what another leaves less of noise alone, ``(n_joints,)``; no better than that one becomes of it."""
    share = without.design.fitted.count / without.design.fitted.count.sum()
    least = np.minimum(without.predicted, with_it.predicted)
    return replace(
        without, predicted=np.maximum(without.predicted - share[:, None] * np.maximum(noise, 0.0), least)
    )


def _noise(full: Baseline, model: Model, moved: ArmSamples) -> Array:
    """Sums of squares of what noise changes in a model's predictions, ``(n_blocks, n_joints)``."""
    base = predicted(full, model).baseline
    own = _driven(base, moved)
    change = _carried(base, moved) + own
    for k in model.chosen:
        term = model.design.terms[k]
        if not term.started and not term.effect.timing:
            x = model.parameters(k)
            change = change + torque_of(_in(term, moved, own), x) - torque_of(term, x)
    power, block = (
        (full.samples.rows(change, range(change.shape[1])).T * full.strict) ** 2,
        model.design.rows.block,
    )
    return np.array([power[:, block == b].sum(axis=1) for b in range(int(block.max()) + 1)])


def _carried(base: Baseline, moved: ArmSamples) -> Array:
    """What a moved motion changes in the torques of the rigid bodies, ``(n_samples, n_joints)``."""
    here, there = (
        s.of_joints(inverse_dynamics(s.robot.model, s.stacked("q"), s.stacked("v"), s.stacked("a"), base.phi))
        for s in (base.samples, moved)
    )
    return there - here


def _driven(base: Baseline, moved: ArmSamples) -> Array:
    """What a moved motion changes in the torques of the drives' own terms, ``(n_samples, n_joints)``."""
    terms, still = own_terms(base.modelled), base.samples
    own = [
        (own_signals(moved, terms, j, sign) - own_signals(still, terms, j, sign)) @ size
        for j, (sign, size) in enumerate(zip(base.signs, base.fit.own, strict=True))
    ]
    return np.column_stack(own)


def _in(term: Term, moved: ArmSamples, own: Array) -> Term:
    """A term in a moved motion, at the inertial parameters that it was made at; ``own`` is the drives' change."""
    base = term.context.baseline
    rigid = _carried(base, moved)
    there = replace(base, samples=moved, rigid=base.rigid + rigid, total=base.total + rigid + own)
    return replace(term, context=Context(there))


# Non-linear parameters of all terms of a model, and how friction changes sign beside them, searched together
# at last.
#
# A term's parameters that were searched while another's were rough have stood in for it, and a friction's
# sign that was chosen without it for both. So all are moved together by Gauss and Newton's steps with
# Levenberg's damping; what is linear is projected out (variable projection: Golub, Pereyra 1973; Kaufman
# 1975), and after each step the predictions that columns are made of are made again.


@dataclass(frozen=True, eq=False)
class Polisher:
    """Searches the non-linear parameters of a model's terms together.

    Attributes:
        library: makes what the model begins with.
    """

    library: Library

    @cached_property
    def _steps(self) -> Steps:
        return Steps(Moved(self.library))

    def polished(self, full: Baseline, rows: Rows, terms: Sequence[Term]) -> State:
        """The terms at their best parameters together, each in the plainest form that says as much.

        Args:
            full: what every model begins with, fitted.
            rows: weighted rows of what is modelled.
            terms: the terms.
        """
        state = State.fitted(full, rows, terms)
        if not knobs_of(state):
            return state
        state = self._steps.searched(state)
        state = State.fitted(state.full, state.rows, state.terms, weight=state.model.weight)
        state = self._in_forms(state)
        rubbing = sorted({knob.joint for knob in knobs_of(state) if knob.term == SIGN})
        before = state.full
        for j in rubbing:
            state = self._plain_sign(state, j)
        state = state if state.full is before else self._in_forms(state)
        # Forms were tried joint by joint, the other joints' columns as they were.
        return min(state, state.remade(state.prediction), key=lambda item: item.loss)

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
        made = TermMaker(state.prediction.without(k), state.full.strict).make(effect, term.location, theta)
        if made is None:
            return state
        begun = state.changed((*state.terms[:k], made, *state.terms[k + 1 :]))
        if not begun.can_be(k):
            return state
        found, spared = self._steps.searched(begun, term.own), term.n_parameters - made.n_parameters
        if not state.can_be(k):
            return found
        return found if found.loss < state.loss + (RICHER + spared if spared > 0 else 0.0) else state

    def _plain_sign(self, state: State, j: int) -> State:
        """A joint's friction without the bristles that it may have been thought to have for want of a term."""
        if not state.full.signs[j].bent:
            return state
        signs = list(state.full.signs)
        signs[j] = SignChange(WIDTHS[len(WIDTHS) // 2])
        new = self._steps.moved.with_signs(state, signs, [term.theta for term in state.terms])
        if new is None:
            return state
        found = self._steps.searched(state.changed(new.terms, new.full, new.rows), j)
        return found if found.loss < state.loss + RICHER else state


def _other_forms(effect: Effect) -> list[Effect]:
    """The form with what a first order leaves out, and the plain one of which an effect is a richer form."""
    others = [] if effect.closer is None else [effect.closer]
    plain = EFFECTS.get(effect.name)
    if plain is None or type(plain) is type(effect):
        return others
    if effect.closer is None and plain.closer is not None:
        plain = plain.closer
    return [*others, plain] if effect.searched[: len(plain.searched)] == plain.searched else others
