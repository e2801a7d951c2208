"""A model's terms beside each other: shapes searched until they hold still, and those kept that predict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array, jackknife_std
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import ShapeStep, Term, TermMaker
from excite.diagnosis.budget.prediction import Prediction, predict_model, signs_beside, torque_of
from excite.diagnosis.budget.record import rows_of
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange
from excite.diagnosis.equations.noise_floor import noisy_motion
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.selection.gram import Gram, Noise
from excite.diagnosis.selection.prior import Slab
from excite.diagnosis.selection.shapes import RICHER, SolvedTerms, search_shapes, shape_changes, step_shape
from excite.progress import step

# Searches at most, and change of a shape's logarithm from which there is another one.
_SEARCHES, _STILL = 8, 0.003
# Nats by which the first search of what may replace another may leave more. Of 14 that were tried on a UR10e and an
# AirBot the six that did began within 3.3, the others 11 and more off.
_FAR = 10.0


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
        if _search_shapes(plain, again, 1).company.loss > found.company.loss + _FAR:
            continue
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


# Terms that predict blocks they were not fitted to, by more than noise of the positions tells.

# Standard deviations that noise may stray by. Of six simulated records of a Jaco2 without any gap one kept a soft gear
# without them, or not, as the draw had it; with them none does. Other numbers were not tried.
_DEVIATIONS = 2.0

# Other forms of a term beside those of a model, likeliest first.
Forms = Callable[[Term, Sequence[Term]], Iterable[Term]]


@step("predict blocks that are left out")
def keep_predictive_terms(
    model: Model, full: Baseline, sigma: Array, forms: Forms, rng: np.random.Generator
) -> list[Term]:
    """Terms of a model without which blocks that are left out are predicted worse, that from noise taken off.

    A law's richer form fits its own blocks and may say nonsense of others, as ten free numbers of a body do of postures
    that one block alone has: before a term goes, other forms of its law are asked. The price of a name was paid by the
    posterior's odds.

    Args:
        model: the model; the weakest of its terms are judged first.
        full: what every model begins with, fitted.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        forms: other forms of a term beside others.
        rng: source of the noise.
    """
    check = _Check(full, noisy_motion(full.samples, sigma, rng))
    model = _drop_unsure_parameters(model, check)
    terms = model.design.terms
    judged = [k for k in model.chosen if not (terms[k].started or terms[k].effect.timing)]
    noise = check.prediction_noise(model)
    for k in sorted(judged, key=model.taken_by):
        without = fit_model(model.design, [i for i in model.chosen if i != k], model.weight)
        more = check.prediction_noise(without)
        if predictive_nats(model, without, more - noise) > 0.0:
            continue
        found, best, left = without, 0.0, more
        for form in forms(model.design.terms[k], without.terms):
            other = check.of_form(model, k, form)
            drawn = check.prediction_noise(other)
            gain = predictive_nats(other, without, more - drawn)
            if gain > best:
                found, best, left = other, gain, drawn
        model, noise = found, left
    return list(model.terms)


def _drop_unsure_parameters(model: Model, check: _Check) -> Model:
    """A model without parameters that are not told from none and predict hardly more of blocks that are left out.

    What a joint's torque takes of the next one's may be unknown where what it takes of the one before is sure.
    """
    k = 0
    while k < len(model.terms):
        term, begin = model.terms[k], model.layout.begin[k]
        free = len(term.kept) > 1 and not (term.known or term.effect.is_body or term.direction is not None)
        size = np.abs(model.term_parameters(k))
        spread = jackknife_std(model.left_out[:, begin : begin + term.n_free])
        weakest = int(np.argmin(size / np.maximum(spread, 1e-300)))
        other = None
        if free and size[weakest] < _DEVIATIONS * spread[weakest]:
            kept = (*term.kept[:weakest], *term.kept[weakest + 1 :])
            maker = TermMaker(term.context, check.full.strict)
            form = maker.make_term(term.effect, term.location, term.theta, kept)
            other = None if form is None else check.of_form(model, k, form)
        if other is not None and predictive_nats(other, model) > -RICHER:
            model = other
        else:
            k += 1
    return model


@dataclass(frozen=True, eq=False)
class _Check:
    """What terms of models say of blocks that they were not fitted to.

    Attributes:
        full: what every model begins with, fitted.
        moved: its samples with as much noise again.
        bodies: by identity of inertial parameters, these and what the noise changes in their torques.
    """

    full: Baseline
    moved: ArmSamples
    bodies: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    def of_form(self, model: Model, k: int, form: Term) -> Model:
        """A model with another form in the place of the design's term ``k``."""
        terms = list(model.design.terms)
        terms[k] = form
        return fit_model(Design(model.design.rows, tuple(terms)), model.chosen, model.weight)

    def prediction_noise(self, model: Model) -> Array:
        """Sums of squares of what noise changes in a model's predictions, ``(n_blocks, n_joints)``."""
        base = predict_model(self.full, model).baseline
        own = _drive_torque_change(base, self.moved)
        change = self.body_change(base) + own
        for k in model.chosen:
            term = model.design.terms[k]
            if not term.started and not term.effect.timing:
                x = model.term_parameters(k)
                change = change + torque_of(self.move_term(term, own), x) - torque_of(term, x)
        rows = self.full.samples.to_rows(change, range(change.shape[1])).T
        power, block = (rows * self.full.strict) ** 2, model.design.rows.block
        return np.array([power[:, block == b].sum(axis=1) for b in range(int(block.max()) + 1)])

    def body_change(self, base: Baseline) -> Array:
        """What the noise changes in the torques of the rigid bodies, ``(n_samples, n_joints)``."""
        if id(base.phi) not in self.bodies:
            here, there = (s.rigid_torques(base.phi) for s in (base.samples, self.moved))
            self.bodies[id(base.phi)] = base.phi, there - here
        return self.bodies[id(base.phi)][1]

    def move_term(self, term: Term, own: Array) -> Term:
        """A term in the moved motion, at the parameters that it was made at; ``own`` is the drives' change."""
        base = term.context.baseline
        rigid = self.body_change(base)
        there = replace(base, samples=self.moved, rigid=base.rigid + rigid, total=base.total + rigid + own)
        return replace(term, context=Context(there))


def predictive_nats(model: Model, without: Model, noise: Array | None = None) -> float:
    """By how many nats a model predicts blocks better than one without a term, what noise makes of it taken off.

    Args:
        without: the same without the term.
        noise: ``(n_blocks, n_joints)`` by how much less of drawn noise the model leaves; None where none is taken off.
    """
    other = without if noise is None else _subtract_noise(without, model, _noise_bound(noise))
    effective = model.effective_share * model.design.fitted.count.sum()
    ratio = other.predicted.sum(axis=0) / model.predicted.sum(axis=0)
    return float(0.5 * (effective * np.log(ratio)).sum())


def _noise_bound(drawn: Array) -> Array:
    """What noise may well have changed in all blocks, ``(n_joints,)``, from one draw by block ``(n_blocks, n_joints)``.

    The record's own noise strays from the mean as far as the drawn noise does: two standard deviations of both.
    """
    return np.asarray(drawn.sum(axis=0) + _DEVIATIONS * np.sqrt(2.0 * len(drawn)) * drawn.std(axis=0))


def _subtract_noise(without: Model, with_it: Model, noise: Array) -> Model:
    """A model less what another leaves less of noise alone, ``(n_joints,)``; no better than that one becomes of it."""
    share = without.design.fitted.count / without.design.fitted.count.sum()
    least = np.minimum(without.predicted, with_it.predicted)
    return replace(
        without, predicted=np.maximum(without.predicted - share[:, None] * np.maximum(noise, 0.0), least)
    )


def _drive_torque_change(base: Baseline, moved: ArmSamples) -> Array:
    """What a moved motion changes in the torques of the drives' own terms, ``(n_samples, n_joints)``."""
    terms, still = own_terms(base.modelled), base.samples
    own = [
        (own_signals(moved, terms, j, sign) - own_signals(still, terms, j, sign)) @ size
        for j, (sign, size) in enumerate(zip(base.signs, base.fit.own_coefs, strict=True))
    ]
    return np.column_stack(own)
