"""The shapes of a model's terms, and friction's changes of sign beside them, searched until they hold still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import fit_model
from excite.diagnosis.budget.fit.terms import ShapeStep, Term, TermMaker
from excite.diagnosis.budget.prediction import Prediction, predict_model, signs_beside
from excite.diagnosis.budget.record import rows_of
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange
from excite.diagnosis.selection.gram import Gram, Noise
from excite.diagnosis.selection.prior import Slab
from excite.diagnosis.selection.shapes import RICHER, SolvedTerms, search_shapes, shape_changes, step_shape

# Searches at most, and change of a shape's logarithm from which there is another one.
_SEARCHES, _STILL = 8, 0.003


@dataclass(frozen=True, eq=False)
class Basis:
    """What every model begins with.

    Attributes:
        full: fitted.
        rows: its rows.
        modelled: words of ``modelled``.
        discrepancy: its columns, by joint.
        noise: of the rows.
        gap: ``(n_joints,)`` RMS without any effect.
    """

    full: Baseline
    rows: Rows
    modelled: tuple[str, ...]
    discrepancy: tuple[Array, ...]
    noise: Noise
    gap: Array

    @cached_property
    def slab(self) -> Slab:
        """The unit of an effect's torque in these rows."""
        return Slab.of_rows(self.rows, self.gap)

    @cached_property
    def gram(self) -> Gram:
        """Products of what every model has, beside which terms are searched."""
        return Gram.of_rows(self.rows, self.discrepancy, (), self.noise)

    def with_baseline(self, full: Baseline) -> Basis:
        """The same with other changes of sign."""
        return replace(self, full=full, rows=rows_of(full, self.modelled, self.noise.floor))


@dataclass(frozen=True, eq=False)
class Settled:
    """Terms at the shapes that fit best together.

    Attributes:
        basis: with friction's changes of sign as beside the terms.
        terms: the terms.
        company: the same, solved.
        makers: by term, makes its columns at what the model predicts.
        now: what the model predicts.
    """

    basis: Basis
    terms: list[Term]
    company: SolvedTerms
    makers: list[TermMaker]
    now: Prediction


def settle_shapes(basis: Basis, terms: Sequence[Term], *, once: bool) -> Settled:
    """Search the shapes of terms together, friction without memory tried beside each effect of friction.

    Bristles bend where friction falls with speed, and may stand for an effect that was not there yet.

    Args:
        basis: what every model begins with.
        once: whether one search does.
    """
    found = _search_shapes(basis, terms, 1 if once else _SEARCHES)
    if once:
        return found
    for j in sorted({int(t.own) for t in found.terms if t.effect.friction and t.own is not None}):
        full = found.basis.full
        if not full.signs[j].has_bristles:
            continue
        signs = [*full.signs[:j], SignChange(WIDTHS[len(WIDTHS) // 2]), *full.signs[j + 1 :]]
        turned = full.with_signs(signs)
        plain = found.basis.with_baseline(turned.with_fit(turned.solver.fit_columns()))
        again = [
            _with_signs(maker, signs).remake_term(term) or term
            for maker, term in zip(found.makers, found.terms, strict=True)
        ]
        other = _search_shapes(plain, again, _SEARCHES)
        if other.company.loss < found.company.loss + RICHER:
            found = other
    return found


def gears_of(terms: Sequence[Term]) -> list[int]:
    """Which of some terms are gears."""
    return [i for i, term in enumerate(terms) if term.known and not term.effect.timing]


def _with_signs(maker: TermMaker, signs: Sequence[SignChange]) -> TermMaker:
    """A maker of terms at other changes of friction's sign."""
    return TermMaker(Context(replace(maker.context.baseline, signs=tuple(signs))), maker.weight)


def _search_shapes(basis: Basis, terms: Sequence[Term], most: int) -> Settled:
    """Terms searched until what the model predicts, of which they are made, moves them no more.

    What a soft gear carries depends on how it swings itself: what it takes from the bodies behind it changes them, and
    they its load. The searches may swing about where they end, so Anderson's mixing (1965) of the last two bodies is
    what comes next.
    """
    terms = list(terms)
    n = basis.rows.shared.shape[2]
    last: tuple[Array, Array] | None = None
    best: Settled | None = None
    x = fit_model(Design(basis.rows, tuple(terms)), range(len(terms)), left_out=False).x[:n]
    for k in range(most):
        before, full = terms, basis.full
        terms = [_refine_delay_term(basis.rows, terms, i) for i in range(len(terms))]
        terms, company = search_shapes(basis.gram, terms, basis.slab)
        model = fit_model(Design(basis.rows, tuple(terms)), range(len(terms)), left_out=False)
        turned = signs_beside(basis.full, model)
        if turned is not basis.full:
            basis = basis.with_baseline(turned)
        there = model.x[:n]
        upcoming = there if last is None else _mix_steps(model.normal[:n, :n], there, there - x, *last)
        last, x = (there, there - x), upcoming
        now = predict_model(basis.full, replace(model, x=np.concatenate([upcoming, model.x[n:]])))
        gears = gears_of(terms)
        makers = [
            TermMaker(now.context_without(*(gears if i in gears else [i])), basis.full.strict)
            for i in range(len(terms))
        ]
        settled = Settled(basis, terms, company, makers, now)
        if best is None or company.loss < best.company.loss:
            best = settled
        if k + 1 == most or (basis.full is full and not _has_moved(before, terms)):
            # Bristles of two kinds at a joint may change places without end.
            return settled if company.loss < best.company.loss + RICHER else best
        terms = [maker.remake_term(term) or term for term, maker in zip(terms, makers, strict=True)]
    raise AssertionError("the last search returns")


def _refine_delay_term(rows: Rows, terms: Sequence[Term], i: int) -> Term:
    """A term; of a delay with its length after one of Gauss and Newton's steps beside the others.

    Rows count alike: whitened ones would tell it by the instants at which friction changes sign, which are late or
    early for reasons of their own.
    """
    term = terms[i]
    if not (term.effect.timing and term.known):
        return term
    maker = TermMaker(term.context, term.context.baseline.strict)
    ((_, change),) = shape_changes(maker, term, np.ones(1))
    step = ShapeStep.from_change(term, change)
    model = fit_model(Design(rows, (*terms, step)), range(len(terms) + 1), left_out=False)
    return step_shape(maker, term, {0: float(model.term_parameters(len(terms))[0])}, 1.0) or term


def _has_moved(before: Sequence[Term], after: Sequence[Term]) -> bool:
    """Whether some shape has changed by more than a trifle."""
    return any(
        bool(np.any(np.abs(np.log(np.divide(new.theta, old.theta))) > _STILL))
        for old, new in zip(before, after, strict=True)
        if new.theta and new.theta != old.theta
    )


def _mix_steps(metric: Array, there: Array, change: Array, before: Array, change_before: Array) -> Array:
    """Between ``there`` and ``before``, where the steps that led to them would cancel (Anderson 1965)."""
    turn = change - change_before
    size = float(turn @ metric @ turn)
    share = float(turn @ metric @ change) / size if size > 0.0 else 0.0
    return there - np.clip(share, -1.0, 0.8) * (there - before)
