"""Predictions of a fitted model of the gap: what its columns are made of when they are made again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import signs_again
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.noise_floor import noisy_motion
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.progress import step
from excite.regressor.kernels import inverse_dynamics

# Standard deviations that noise may stray by. Of six simulated records of a Jaco2 without any gap one kept a soft gear
# without them, or not, as the draw had it; with them none does. Other numbers were not tried.
_DEVIATIONS = 2.0


@step("allow for noise of positions")
def unlike_noise(
    model: Model, full: Baseline, sigma: Array, candidates: int, rng: np.random.Generator
) -> list[int]:
    """Terms of a model whose gain is worth its price though that from noise is taken off.

    Args:
        model: the model; the weakest of its terms are judged first.
        full: what every model begins with, fitted.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        candidates: number of effects and places that were tried.
        rng: source of the noise.

    Returns:
        Indices of the terms in the model's design.
    """
    terms = model.design.terms
    judged = [k for k in model.chosen if not (terms[k].started or terms[k].effect.timing)]
    if not judged:
        return list(model.chosen)
    moved = noisy_motion(full.samples, sigma, rng)
    noise = _noise(full, model, moved)
    for k in sorted(judged, key=model.taken_by):
        without = fit(model.design, [i for i in model.chosen if i != k], model.weight)
        more = _noise(full, without, moved)
        quieter = _quieter(without, model, _likely(more - noise))
        if _nats(quieter, model) <= price_of(terms[k], candidates):
            model, noise = without, more
    return list(model.chosen)


def _nats(without: Model, with_it: Model) -> float:
    """How many nats a model predicts left-out blocks better by than another, against what stays unexplained with it."""
    effective = with_it.share * with_it.design.fitted.count.sum()
    return float(
        0.5 * (effective * np.log(without.predicted.sum(axis=0) / with_it.predicted.sum(axis=0))).sum()
    )


def price_of(term: Term, candidates: int) -> float:
    """Nats that a term costs among so many effects and places that were tried."""
    more = 0.5 * max(term.n_parameters - 1, 0)
    return float(THRESHOLDS.price + 0.5 * np.log(max(candidates, 1)) + more)


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


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's torques, and those of each of its terms.

    Attributes:
        baseline: with all terms in its predictions; delays and lags are readings, which no torque follows.
        torques: by index of the term, full rate ``(n_samples, n_joints)``; what the model begins with is not listed.
        moves: by index of the term, whether it is a torque that gears carry.
    """

    baseline: Baseline
    torques: dict[int, Array]
    moves: dict[int, bool]

    @property
    def context(self) -> Context:
        """With all terms."""
        return Context(self.baseline)

    def without(self, *terms: int) -> Context:
        """As terms' own columns need it: a gear's load is not what it makes of it itself."""
        base = self.baseline
        for k in terms:
            if k not in self.torques:
                continue
            torque, total = self.torques[k], base.total - self.torques[k]
            if self.moves[k]:
                base = replace(base, rigid=base.rigid - torque, total=total, added=base.added - torque)
            else:
                base = replace(base, total=total, added_drive=base.added_drive - torque)
        return Context(base)


def predicted(full: Baseline, model: Model) -> Prediction:
    """Torques of a fitted model.

    Args:
        full: what every model begins with, fitted.
        model: the model.
    """
    s, index = full.samples, list(full.samples.index)
    x = model.x[: full.basis.shape[1]]
    phi, rigid = full.phi, full.rigid
    if full.free:
        phi = full.phi + full.basis @ (x - full.fit.shared)
        q, v, a = (s.stacked(name) for name in ("q", "v", "a"))
        rigid = inverse_dynamics(s.robot.model, q, v, a, phi)[:, index]
    moved, driven = np.zeros_like(rigid), full.added_drive.copy()
    y, known = full.solver.equations.y.copy(), full.strict > 0.0
    back = np.where(known, full.root_weight, 0.0) / np.where(known, full.strict, 1.0)
    torques, moves = {}, {}
    for k in model.chosen:
        term = model.design.terms[k]
        if term.started:
            continue
        for j, block in term.columns.items():
            y[j] -= (block @ model.parameters(k)) * back[j]
        if term.effect.timing:
            continue
        torques[k] = torque_of(term, model.parameters(k))
        moves[k] = term.effect.moves
        (moved if moves[k] else driven)[:] += torques[k]
    now = replace(full.fit, equations=replace(full.solver.equations, y=y), shared=x, held=None)
    terms = own_terms(full.modelled)
    own = [own_signals(s, terms, j, sign) @ now.own[j] for j, sign in enumerate(full.signs)]
    rigid = rigid + moved
    total = rigid + np.column_stack(own) + driven
    base = replace(full, fit=now, phi=phi, rigid=rigid, total=total, added=moved, added_drive=driven)
    return Prediction(base, torques, moves)


def signs_beside(full: Baseline, model: Model) -> Baseline:
    """What every model begins with, its friction's sign changes searched again: a large effect has bent them.

    Args:
        full: what every model begins with, fitted.
        model: the model so far.
    """
    now = predicted(full, model).baseline
    apart = replace(now, solver=Solver(now.fit.equations))
    again = signs_again(apart.updated(apart.solver.fit()))
    if again.signs == full.signs:
        return full
    moved = full.with_signs(again.signs)
    return moved.updated(moved.solver.fit())


def torque_of(term: Term, x: Array) -> Array:
    """What a fitted term adds to the torques at full rate, ``(n_samples, n_joints)``."""
    shape = term.effect.shape(term.context, term.location, term.theta)
    torque = np.zeros_like(term.context.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ term.beta(x)
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
