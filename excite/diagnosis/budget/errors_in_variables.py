"""Terms that only damp the noise of the measured motion, taken out again.

Predicted torques follow measured positions, and so does what a term makes of them: both have the same noise. A term
that damps its own motion where noise is strong, a soft gear or a body that takes inertia away, then predicts torques
better without being there: the attenuation of errors in variables (Carroll et al. 2006, chapter 3). With the motion
moved by as much noise again and all parameters held, what a model leaves grows by the part that is noise's; by as much
less as it grows with a term than without, the term has gained nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.prediction import predicted, torque_of
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
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
