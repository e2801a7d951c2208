"""How far the gap shrinks on the validation trials, wrench component by component."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.floating.band import in_band
from excite.diagnosis.floating.parameter_errors import left_by_parameters
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.ranking import NOISE_SLACK
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.refinement import Fitted, explained_state
from excite.diagnosis.gap import ChannelGap, Gap, share_closed
from excite.logs.columns import WRENCH_AXES
from excite.robot.robot import Array

UNITS = ("N",) * 3 + ("N·m",) * 3
_BLOCK_S, _DRAWS = 1.0, 500
_ONE_SIDE = 0.05
# Noise has few independent numbers in a band of a few hertz, and trials as short as these.
_LEAST_SPREAD, _LARGEST_SPREAD = 0.12, 0.3
_UPPER_END_HZ = 2.4
_LOUDER_STD, _LOUDER_RANGE = 0.06, (0.7, 1.5)


def residual_of(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6)`` measured less predicted with a fit's effects and inertials, in band [N, N·m]."""
    return in_band(problem.record, explained_state(problem, fitted).residual)


def noise_floor(problem: Problem) -> Array:
    """``(6,)`` standard deviation of the noise in band, from the noise model [N, N·m]."""
    total = np.zeros(6)
    for factor, span in zip(problem.whitening.factors, problem.record.spans, strict=True):
        covariance = np.linalg.inv(np.einsum("kji,kjl->kil", factor, factor))
        power = np.diagonal(covariance, axis1=1, axis2=2).copy()
        # All bins but the first stand for a real and an imaginary part, and for their mirror images.
        power[1:] *= 4.0
        total += power.sum(axis=0) / (span.stop - span.start)
    return np.sqrt(total / len(problem.record.spans))


def _spread(problem: Problem, powers: list[float]) -> float:
    """How far the noise's power in the validation trials may be from what was learnt, relative.

    Args:
        problem: the problem.
        powers: what a fit leaves of each trial.
    """
    held_out = np.array(problem.record.validation)
    fitted = np.array(powers)[~held_out]
    if len(fitted) < 3:
        return _LARGEST_SPREAD
    share = float(fitted.std(ddof=1) / fitted.mean()) / np.sqrt(max(1, held_out.sum()))
    return float(np.clip(share, _LEAST_SPREAD, _LARGEST_SPREAD))


def _louder(record: FloatingRecord, residual: Array) -> float:
    """Amplitude of the noise in the validation trials over that in the others, from the band's upper end.

    Motion is slower than that, so that what a fit leaves there is noise; other motions carry more or less of the
    kinematics' noise into the equations. 1 where there are no validation trials, or no others.

    Args:
        record: the record.
        residual: ``(n, 6)`` in band, channels of like size.
    """
    powers: tuple[list[float], list[float]] = ([], [])
    for span, held_out in zip(record.spans, record.validation, strict=True):
        n = span.stop - span.start
        upper = np.fft.rfftfreq(n, 1.0 / record.rate_hz) >= _UPPER_END_HZ
        powers[held_out].append(float((np.abs(np.fft.rfft(residual[span], axis=0)[upper]) ** 2).sum() / n**2))
    others, validation = powers
    if not others or not validation or min(others) <= 0.0:
        return 1.0
    more = float(np.sqrt(np.mean(validation) / np.mean(others))) - 1.0
    # What so few numbers say by chance is taken back (James and Stein 1961).
    more *= max(0.0, 1.0 - (_LOUDER_STD / max(abs(more), 1e-9)) ** 2)
    return float(np.clip(1.0 + more, *_LOUDER_RANGE))


def _repeated(record: FloatingRecord, residual: Array) -> Array:
    """``(6,)`` standard deviation of the noise from pairs of repeated trials; infinity where there are none.

    What a wrong form leaves is the same in both: of all levels this is the one that holds nothing of it.
    """
    powers = []
    for first, second in record.repeats:
        one, two = record.spans[first], record.spans[second]
        n = min(one.stop - one.start, two.stop - two.start)
        change = residual[one.start : one.start + n] - residual[two.start : two.start + n]
        powers.append(0.5 * (change**2).mean(axis=0))
    return np.sqrt(np.mean(powers, axis=0)) if powers else np.full(6, np.inf)


def _interval(left: Array, told: bool, share: float) -> tuple[float, float]:
    """90 % interval of the share closed.

    Where what is left is told from noise, it has two sides. Where it is not, nothing speaks against a model that
    closes all, and the interval is one-sided: 1, and what nine draws of ten exceed.

    Args:
        left: draws of what is left of the gap's power.
        told: whether there is more of it than noise can be.
        share: the share that is stated, which is always inside.
    """
    if told:
        most, least = (float(x) for x in np.quantile(left, [1.0 - _ONE_SIDE, _ONE_SIDE]))
    else:
        most, least = float(np.quantile(left, 1.0 - 2.0 * _ONE_SIDE)), 0.0
    return min(max(0.0, 1.0 - most), share), max(1.0 - least, share)


def gap_of(problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator) -> Gap:
    """Gap of the baseline and of the accepted effects, both fitted to the identification trials.

    Args:
        problem: the problem.
        before: the baseline's fit.
        after: the fit with the effects.
        rng: of the block bootstrap that gives the interval of the share closed.
    """
    record = problem.record
    held_out = record.validation_samples()
    rows = held_out if held_out.any() else ~held_out
    measured = in_band(record, problem.nominal.measured)
    train = measured[~held_out] if (~held_out).any() else measured
    scale = np.maximum(train.std(axis=0), 1e-9)
    old, fitted = residual_of(problem, before)[rows], residual_of(problem, after)
    new, learnt = fitted[rows], noise_floor(problem)
    # What is left in the trials that were fitted says how loud the noise is, as far as noise can be that loud.
    seen = np.sqrt((fitted[~rows if (~rows).any() else rows] ** 2).mean(axis=0))
    louder = _louder(record, fitted / scale)
    level = louder * np.minimum(seen, np.sqrt(NOISE_SLACK) * learnt)
    blocks = np.array_split(np.arange(len(old)), max(2, round(len(old) / (_BLOCK_S * record.rate_hz))))
    powers = [np.array([(x[b] ** 2).mean(axis=0) for b in blocks]) for x in (old, new)]

    def total(power: Array) -> float:
        return float(np.sqrt(np.mean(power / scale**2)))

    first, last = (total(power.mean(axis=0)) for power in powers)
    # Noise happens to be a little less than it is on average.
    floor, interval = level * min(1.0, last / total(level**2)), None
    if after.placed:
        spread = _spread(problem, [total((fitted[span] ** 2).mean(axis=0)) ** 2 for span in record.spans])
        quietest = np.minimum(level, louder * np.minimum(learnt, _repeated(record, fitted))) ** 2
        by_parameters = left_by_parameters(problem, after, scale, rows, rng, _DRAWS)
        left, opened = np.empty(_DRAWS), np.empty(_DRAWS)
        for k in range(_DRAWS):
            pick = rng.integers(0, len(blocks), len(blocks))
            was, now = (total(power[pick].mean(axis=0)) for power in powers)
            power = quietest + rng.uniform() * (level**2 - quietest)
            quiet = total(power * max(0.0, 1.0 + spread * rng.standard_normal()))
            left[k], opened[k] = now**2 - quiet**2, was**2 - quiet**2
        told = float(np.quantile(left, _ONE_SIDE)) > 0.0
        if not told:
            # What is left may all be noise, but for what errors of the parameters are expected to leave.
            floor = level * np.sqrt(max(0.0, last**2 - by_parameters.mean())) / total(level**2)
    share = share_closed(first, last, total(floor**2))
    if after.placed:
        interval = _interval(np.maximum(left, by_parameters) / np.maximum(opened, 1e-12), told, share)
    channels = {
        axis: ChannelGap(
            float(np.sqrt((old[:, i] ** 2).mean())),
            float(np.sqrt((new[:, i] ** 2).mean())),
            float(floor[i]),
            UNITS[i],
        )
        for i, axis in enumerate(WRENCH_AXES)
    }
    return Gap(first, last, total(floor**2), share, channels, interval)
