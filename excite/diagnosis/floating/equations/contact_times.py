"""When was there a contact: two levels in what the baseline leaves."""

from __future__ import annotations

import numpy as np
import scipy

from excite.arrays import Array
from excite.diagnosis.floating.effects.unlogged_contact import UnloggedContact
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.refinement import (
    Fitted,
    Placed,
    apply_all,
    explained_state,
    linearised,
    refine,
)
from excite.diagnosis.floating.search.screening import effect_columns
from excite.logs.signals.butterworth import lowpass

_SMOOTH_HZ = 3.0
_SHORTEST_S = 0.25
_ROUNDS = 4
# Share of the variance that two levels must explain: 0.64 for Gaussian noise, 0.75 for an even spread.
_TWO_LEVELS = 0.8
# Each change between contact and none is a free moment in time.
_PRICE_OF_A_SWITCH = 6.0


def find_contact(problem: Problem, before: Fitted, shortlist: int = 2) -> Fitted | None:
    """Alternate between when and where, from two clusters of the smoothed residual; None if there are not two.

    Args:
        problem: the problem.
        before: what is explained already.
        shortlist: places refined a round.
    """
    residual = _smooth(problem, _leftover(problem, before))
    noise = np.sqrt(np.diag(problem.record.sensor_noise))
    centred = (residual - residual.mean(axis=0)) / noise
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    score = centred @ direction
    low, high = _two_means(score)
    upper = score > 0.5 * (low + high)
    between = upper.mean() * (1.0 - upper.mean()) * (high - low) ** 2
    if between < _TWO_LEVELS * score.var():
        return None
    best: Fitted | None = None
    for raw in ((score - low) / (high - low), (high - score) / (high - low)):
        found = _alternate(problem, before, _tidy(problem, raw), shortlist)
        if found is not None and (best is None or found.evidence > best.evidence):
            best = found
        if best is not None and best.power < 2.0 * len(problem.nominal_rows):
            break
    return best


def _alternate(problem: Problem, before: Fitted, share: Array, shortlist: int) -> Fitted | None:
    best: Fitted | None = None
    beside, state, rows = linearised(problem, before)
    for _ in range(_ROUNDS):
        price = _PRICE_OF_A_SWITCH * float((np.abs(np.diff(share > 0.5))).sum())
        effect = UnloggedContact(share, share[problem.record.every_other], price)
        ranked = sorted(
            (
                (
                    beside.fit(
                        rows, effect_columns(problem, state, effect, link, effect.beginnings(state, link)[0])
                    ),
                    link,
                )
                for link in effect.locations(state)
            ),
            key=lambda item: -item[0].evidence,
        )[:shortlist]
        fits = [
            refine(
                problem,
                (*before.placed, Placed(effect, link)),
                (*before.theta, fit.theta * effect.scales(state, link)),
                before,
            )
            for fit, link in ranked
        ]
        found = max(fits, key=lambda item: item.evidence)
        if best is not None and found.evidence <= best.evidence + 1.0:
            return best
        best = found
        share = _tidy(problem, pulled(problem, found))
        if not 0.01 < share.mean() < 0.99:
            return best
    return best


def _leftover(problem: Problem, fitted: Fitted) -> Array:
    return explained_state(problem, fitted).residual


def pulled(problem: Problem, fitted: Fitted) -> Array:
    """Share of the fitted force that acts at each instant, ``(n,)``, by weighted projection."""
    *_, place = fitted.placed
    *_, force = fitted.theta
    state = problem.state(fitted.delta)
    state = apply_all(state, fitted.placed[:-1], fitted.theta[:-1])
    always = UnloggedContact(np.ones(problem.record.n_samples)).apply(state, place.location, force)
    pull = state.residual - always.residual
    weight = np.linalg.inv(problem.record.sensor_noise)
    residual = np.concatenate(
        [lowpass(state.residual[s], problem.record.rate_hz, 5.0) for s in problem.record.spans]
    )
    return np.einsum("ni,ij,nj->n", residual, weight, pull) / np.einsum("ni,ij,nj->n", pull, weight, pull)


def _tidy(problem: Problem, raw: Array) -> Array:
    """On and off with the shortest spells removed; near a change, the measured share itself."""
    width = 2 * max(1, round(0.5 * _SHORTEST_S * problem.record.rate_hz)) + 1
    share = np.empty_like(raw)
    for span in problem.record.spans:
        on = scipy.ndimage.median_filter((raw[span] > 0.5).astype(float), width, mode="nearest")
        change = np.flatnonzero(np.diff(on))
        share[span] = on
        for index in change:
            near = slice(max(0, index - 2), min(len(on), index + 4))
            share[span][near] = np.clip(raw[span][near], 0.0, 1.0)
    return share


def _smooth(problem: Problem, values: Array) -> Array:
    rate = problem.record.rate_hz
    return np.concatenate([lowpass(values[span], rate, _SMOOTH_HZ) for span in problem.record.spans])


def _two_means(score: Array, rounds: int = 20) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(score, [0.1, 0.9]))
    for _ in range(rounds):
        upper = score > 0.5 * (low + high)
        if upper.all() or not upper.any():
            break
        low, high = float(score[~upper].mean()), float(score[upper].mean())
    return low, high
