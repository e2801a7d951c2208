"""What is moved when a model's non-linear parameters are searched together: terms' own, and friction's sign changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from excite.diagnosis.budget.fit.design import Rows
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.polish.state import State, made_like
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Theta
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import SignChange, width_bounds
from excite.diagnosis.equations.own_columns import (
    BREAKAWAY_BOUNDS,
    COULOMB,
    own_rows,
    own_terms,
)

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
