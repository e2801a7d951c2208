"""Terms of a model that predict blocks they were not fitted to, by more than noise of the positions tells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.prediction import predict_model, torque_of
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import noisy_motion
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.progress import step

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


@dataclass(frozen=True, eq=False)
class _Check:
    """What terms of models say of blocks that they were not fitted to.

    Attributes:
        full: what every model begins with, fitted.
        moved: its samples with as much noise again.
    """

    full: Baseline
    moved: ArmSamples

    def of_form(self, model: Model, k: int, form: Term) -> Model:
        """A model with another form in the place of the design's term ``k``."""
        terms = list(model.design.terms)
        terms[k] = form
        return fit_model(Design(model.design.rows, tuple(terms)), model.chosen, model.weight)

    def prediction_noise(self, model: Model) -> Array:
        """Sums of squares of what noise changes in a model's predictions, ``(n_blocks, n_joints)``."""
        base = predict_model(self.full, model).baseline
        own = _drive_torque_change(base, self.moved)
        change = _body_torque_change(base, self.moved) + own
        for k in model.chosen:
            term = model.design.terms[k]
            if not term.started and not term.effect.timing:
                x = model.term_parameters(k)
                change = change + torque_of(_move_term(term, self.moved, own), x) - torque_of(term, x)
        rows = self.full.samples.to_rows(change, range(change.shape[1])).T
        power, block = (rows * self.full.strict) ** 2, model.design.rows.block
        return np.array([power[:, block == b].sum(axis=1) for b in range(int(block.max()) + 1)])


def predictive_nats(model: Model, without: Model, noise: Array) -> float:
    """By how many nats a model predicts blocks better than one without a term, what noise makes of it taken off.

    Args:
        without: the same without the term.
        noise: ``(n_blocks, n_joints)`` by how much less of drawn noise the model leaves.
    """
    quieter = _subtract_noise(without, model, _noise_bound(noise))
    effective = model.effective_share * model.design.fitted.count.sum()
    ratio = quieter.predicted.sum(axis=0) / model.predicted.sum(axis=0)
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


def _body_torque_change(base: Baseline, moved: ArmSamples) -> Array:
    """What a moved motion changes in the torques of the rigid bodies, ``(n_samples, n_joints)``."""
    here, there = (s.rigid_torques(base.phi) for s in (base.samples, moved))
    return there - here


def _drive_torque_change(base: Baseline, moved: ArmSamples) -> Array:
    """What a moved motion changes in the torques of the drives' own terms, ``(n_samples, n_joints)``."""
    terms, still = own_terms(base.modelled), base.samples
    own = [
        (own_signals(moved, terms, j, sign) - own_signals(still, terms, j, sign)) @ size
        for j, (sign, size) in enumerate(zip(base.signs, base.fit.own_coefs, strict=True))
    ]
    return np.column_stack(own)


def _move_term(term: Term, moved: ArmSamples, own: Array) -> Term:
    """A term in a moved motion, at the inertial parameters that it was made at; ``own`` is the drives' change."""
    base = term.context.baseline
    rigid = _body_torque_change(base, moved)
    there = replace(base, samples=moved, rigid=base.rigid + rigid, total=base.total + rigid + own)
    return replace(term, context=Context(there))
