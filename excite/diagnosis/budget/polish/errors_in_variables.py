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
from excite.diagnosis.budget.evidence import merit
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.prediction import predicted, torque_of
from excite.diagnosis.budget.search import Search
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.kinematic_noise import noisy_motion
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.progress import step
from excite.regressor.kernels import inverse_dynamics

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
