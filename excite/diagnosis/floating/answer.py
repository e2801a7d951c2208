"""The map of the gap and its curves for robots with a free base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.gap import ChannelGap, Curves, Gap, Where, locate_residual, share_closed
from excite.diagnosis.floating.hypotheses import Fitted, columns_of, explained_state, nominal_fit, refine_fit
from excite.diagnosis.floating.problem import Problem, noise_floor, noise_level
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.spectrum import BAND_HZ, in_band
from excite.diagnosis.floating.state import State

# Curves of the wrench on the base.


def trial_curves(problem: Problem, before: Fitted, after: Fitted) -> Curves:
    """The wrench on the base in the first validation trial, in the first trial where there is none.

    Args:
        before: the baseline's fit.
        after: the fit with the effects.
    """
    record = problem.record
    chosen = next((k for k, outside in enumerate(record.validation) if outside), 0)
    span = record.spans[chosen]
    measured = problem.nominal.measured_forces[span]
    return Curves(
        trial=record.trials[chosen],
        validation=record.validation[chosen],
        channels=tuple(problem.nominal.channel_units),
        units=tuple(problem.nominal.channel_units.values()),
        time=np.arange(len(measured)) / record.rate_hz,
        measured=measured,
        before=measured - explained_state(problem, before).residual[span],
        after=measured - explained_state(problem, after).residual[span],
    )


# How far the gap shrinks on the validation trials, wrench component by component.


def residual_of(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6)`` measured less predicted with a fit's effects and inertials, in band [N, N·m]."""
    return in_band(problem.record, explained_state(problem, fitted).residual)


def gap_of(problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator) -> Gap:
    """Gap of the baseline and of the accepted effects, both fitted to the identification trials.

    Args:
        before: the baseline's fit.
        after: the fit with the effects.
        rng: of the block bootstrap that gives the interval of the share closed.
    """
    record = problem.record
    held_out = record.validation_samples()
    rows = held_out if held_out.any() else ~held_out
    measured = in_band(record, problem.nominal.measured_forces)
    train = measured[~held_out] if (~held_out).any() else measured
    scale = np.maximum(train.std(axis=0), 1e-9)
    residuals = (residual_of(problem, before), residual_of(problem, after))
    old, new = (residual[rows] for residual in residuals)
    first, last = (float(((x / scale) ** 2).mean()) for x in (old, new))
    noise = noise_level(problem, residuals[1], scale, rows)
    level = noise.likely
    loud, least = (float(((x / scale) ** 2).mean()) for x in (level, noise.least))
    # Noise happens to be a little less, or more, than it is on average.
    left = describe_residual(problem, residuals, after, scale, rows, rng) if after.placed else None
    quiet = min(loud, last) if left is None else max(min(least, last), last - left.power)
    floor = level * np.sqrt(quiet / loud)
    start, end, noise_size = (float(np.sqrt(power)) for power in (first, last, quiet))
    share = share_closed(start, end, noise_size)
    interval = None
    if left is not None:
        lowest, most = left.interval
        interval = (min(share, 1.0 - most), max(share, 1.0 - lowest))
    channels = {
        axis: ChannelGap(
            float(np.sqrt((old[:, i] ** 2).mean())),
            float(np.sqrt((new[:, i] ** 2).mean())),
            float(floor[i]),
            unit,
        )
        for i, (axis, unit) in enumerate(problem.nominal.channel_units.items())
    }
    return Gap(start, end, noise_size, share, channels, interval)


# How much of a gap its effects leave, and how well that is known.

# Blocks are longer than what is left of a motion below a hertz remembers.
_BLOCK_S, _DRAWS, _ONE_SIDE = 2.0, 500, 0.05
_NEARLY_ALL, _SLOWEST_HZ = 0.97, 0.8
# Of a Gaussian, exceeded in one case of twenty.
_ONE_SIDED_STD = 1.64


@dataclass(frozen=True)
class GapResidual:
    """What effects leave of a gap.

    Attributes:
        power: expected mean square over channels, each in units of its scale.
        interval: 90 % interval of its share of the gap's power.
    """

    power: float
    interval: tuple[float, float]


def describe_residual(
    problem: Problem,
    residuals: tuple[Array, Array],
    after: Fitted,
    scale: Array,
    judged: NDArray[np.bool_],
    rng: np.random.Generator,
) -> GapResidual:
    """What effects leave on the trials that a gap is judged on, looked for where they explain something.

    Where it is told from noise, a block bootstrap over time and over the noise's level gives an interval of two
    sides. Where it is not, nothing speaks against a model that closes all: errors of the parameters are expected
    to leave what is left, and the interval has one side: nothing, and what nine draws of ten stay below.

    Args:
        residuals: before and after, ``(n, 6)`` each, in band [N, N·m].
        after: the effects' fit.
        scale: ``(6,)`` of the channels.
        judged: ``(n,)`` which samples are judged.
        rng: of the bootstrap.
    """
    record = problem.record
    below = _explained_below(record, (residuals[0] - residuals[1]) / scale)
    noise = noise_level(problem, residuals[1], scale, judged, below)
    likely, least = (float(((x / scale) ** 2).mean()) for x in (noise.likely, noise.least))
    old, new = (((in_band(record, x, below)[judged] / scale) ** 2).mean(axis=1) for x in residuals)
    blocks = np.array_split(np.arange(len(old)), max(2, round(len(old) / (_BLOCK_S * record.rate_hz))))
    was, now = (np.array([x[block].mean() for block in blocks]) for x in (old, new))
    pick = rng.integers(0, len(blocks), (_DRAWS, len(blocks)))
    quiet = least + rng.uniform(size=_DRAWS) * (likely - least)
    quiet *= np.maximum(0.0, 1.0 + noise.spread * rng.standard_normal(_DRAWS))
    left, opened = now[pick].mean(axis=1) - quiet, np.maximum(was[pick].mean(axis=1) - quiet, 1e-12)
    by_parameters = draw_residual_power(problem, after, scale, judged, rng, _DRAWS)
    share = np.minimum(1.0, np.maximum(left, by_parameters) / opened)
    if np.quantile(left, _ONE_SIDE) > 0.0 and _louder_than_noise(problem, after):
        low, high = np.quantile(share, [_ONE_SIDE, 1.0 - _ONE_SIDE])
        return GapResidual(max(float(left.mean()), float(by_parameters.mean())), (float(low), float(high)))
    return GapResidual(float(by_parameters.mean()), (0.0, float(np.quantile(share, 1.0 - 2.0 * _ONE_SIDE))))


def _louder_than_noise(problem: Problem, after: Fitted) -> bool:
    """Whether whitened numbers of the judged trials, too, are larger than independent ones of unit variance."""
    white = problem.residual_rows(explained_state(problem, after))
    judged = white[problem.validation_rows] if problem.validation_rows.any() else white
    return float((judged**2).mean()) > 1.0 + _ONE_SIDED_STD * np.sqrt(2.0 / len(judged))


def _explained_below(record: FloatingRecord, explained: Array) -> float:
    """Frequency [Hz] below which nearly all of what effects explain lies, ``explained (n, k)``.

    What they leave is as slow as what they explain, and noise above it says nothing of it.
    """
    frequency = np.fft.rfftfreq(max(span.stop - span.start for span in record.spans), 1.0 / record.rate_hz)
    power = np.zeros(len(frequency))
    for span in record.spans:
        spectrum = np.abs(np.fft.rfft(explained[span], 2 * (len(frequency) - 1), axis=0)) ** 2
        power += spectrum.sum(axis=1)
    below = np.searchsorted(np.cumsum(power), _NEARLY_ALL * power.sum())
    return float(np.clip(frequency[min(int(below), len(frequency) - 1)], _SLOWEST_HZ, BAND_HZ))


# What errors of the fitted parameters leave of a gap, noise or not.


def draw_residual_power(
    problem: Problem,
    fitted: Fitted,
    scale: Array,
    samples: NDArray[np.bool_],
    rng: np.random.Generator,
    draws: int,
) -> Array:
    """Draws of the mean square, over channels in units of ``scale``, that a fit's parameters leave by their errors.

    Noise in the trials that were fitted moves the parameters by what their posterior covariance says
    (MacKay 1992, eq. 2.8); what that does to the residual of other trials is linear in it.

    Args:
        fitted: a fit to its identification trials, with effects.
        scale: ``(6,)`` of the channels [N, N·m].
        samples: ``(n,)`` which samples are looked at.
        rng: of the draws.
        draws: how many.

    Returns:
        ``(draws,)``.
    """
    seen = problem.identification_only
    columns = np.hstack([seen.columns, columns_of(seen, fitted)])
    noise = (seen.residual_rows(explained_state(seen, fitted)) ** 2).sum() / max(
        1, int((columns != 0.0).any(axis=1).sum())
    )
    precision = columns.T @ columns / max(1.0, float(noise)) + np.eye(columns.shape[1])
    turned = _in_samples(problem, fitted)
    n = len(turned)
    turned = in_band(problem.record, turned.reshape(n, -1)).reshape(turned.shape)[samples] / scale[:, None]
    flat = turned.reshape(-1, turned.shape[2])
    root = scipy.linalg.cholesky(precision, lower=True)
    spread = scipy.linalg.solve_triangular(root, flat.T @ flat / len(flat), lower=True)
    spread = scipy.linalg.solve_triangular(root, spread.T, lower=True)
    power = np.maximum(np.linalg.eigvalsh(spread), 0.0)
    return np.asarray(rng.chisquare(1.0, (draws, len(power))) @ power)


def _in_samples(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6, p + k)`` minus the derivative of the residual by the baseline's and the effects' scaled parameters."""
    parts = [problem.error_columns]
    state = problem.state_with_errors(fitted.delta)
    for item, theta in zip(fitted.placed, fitted.theta, strict=True):
        effect, place = item.effect, item.location
        parts.append(effect.residual_columns(state, place, theta) * effect.parameter_scales(state, place))
        state = effect.apply_to(state, place, theta)
    return np.concatenate(parts, axis=2)


# Fits that do not see the validation trials.


def held_out_gain(problem: Problem, without: Fitted, candidate: Fitted) -> float:
    """Nats by which a further effect, learnt from the other trials, makes the validation trials likelier.

    The predictive likelihood of one part given another is the evidence of all less that of the other, so that what
    few trials leave open of all parameters is no reproach to either model. Positive infinity where there are no
    validation trials: nothing speaks against it.
    """
    if not problem.validation_rows.any() or problem.validation_rows.all():
        return float("inf")
    restricted = problem.identification_only
    baseline, nats = nominal_fit(restricted), []
    for fitted in (without, candidate):
        alone = refine_fit(restricted, fitted.placed, fitted.theta, fitted) if fitted.placed else baseline
        nats.append(0.5 * (alone.power - fitted.power) + alone.price - fitted.price)
    return nats[1] - nats[0]


# Where a gap lies: wrench component by component.


def locate_gap(problem: Problem, fitted: Fitted) -> tuple[Where, ...]:
    """Map of what a fit leaves, largest share first; ``depends_on`` names what explains most of a component."""
    record = problem.record
    state = explained_state(problem, fitted)
    residual, floor = in_band(record, state.residual), noise_floor(problem)
    scale = np.maximum(in_band(record, problem.nominal.measured_forces).std(axis=0), 1e-9)
    power = np.maximum((residual**2).mean(axis=0) - floor**2, 0.0) / scale**2
    total = max(float(power.sum()), 1e-300)
    features = _dependence_features(problem, state)
    lines = [
        locate_residual(
            axis,
            float(power[i] / total),
            residual[:, i],
            features,
            [residual[span, i] for span in record.spans],
            record.rate_hz,
        )
        for i, axis in enumerate(problem.nominal.channel_units)
    ]
    return tuple(sorted(lines, key=lambda line: -line.share))


def _dependence_features(problem: Problem, state: State) -> dict[str, Array]:
    record = problem.record
    base_a, base_v = state.a[:, :6], state.v[:, :6]
    start = np.concatenate([np.full(s.stop - s.start, i) for i, s in enumerate(record.spans)])
    load = np.hstack([in_band(record, values) for values in record.readings.values()])
    return {
        "constant": np.ones((record.n_samples, 1)),
        "time": np.column_stack([record.time, record.time**2]) * 1.0,
        "trial": (start[:, None] == np.arange(len(record.spans))).astype(float),
        "load": load,
        "velocity": base_v,
        "acceleration": in_band(record, base_a),
        "position": np.hstack([state.q[:, :3], state.q[:, 3:6]]),
    }
