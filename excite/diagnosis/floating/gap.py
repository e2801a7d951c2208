"""How far the gap shrinks on the validation trials, wrench component by component."""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import tukey

from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.ranking import NOISE_SLACK
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.refinement import Fitted, explained_state
from excite.diagnosis.floating.spectrum import BAND_HZ
from excite.diagnosis.gap import ChannelGap, Gap, share_closed
from excite.logs.columns import WRENCH_AXES
from excite.robot.robot import Array

UNITS = ("N",) * 3 + ("N·m",) * 3
_BLOCK_S, _DRAWS = 1.0, 500
# Noise has few independent numbers in a band of a few hertz, and trials as short as these.
_LEAST_SPREAD, _LARGEST_SPREAD = 0.12, 0.3
_MOTION_HZ, _UPPER_END_HZ = 1.2, 2.4
_LOUDER_STD, _LOUDER_RANGE = 0.06, (0.7, 1.5)
# Of the logarithm of how much of the parameters' errors shows: other motions ask other things of them.
_UNCERTAIN_SPREAD = 1.0


def in_band(record: FloatingRecord, values: Array) -> Array:
    """``(n, k)`` without what is above the band that the diagnosis looks at; ends of trials are faded out.

    A sharp edge in frequency, so that the noise model, which is for the band alone, says what noise is left.
    """
    out = []
    for span in record.spans:
        n = span.stop - span.start
        taper = tukey(n, 0.1)
        spectrum = np.fft.rfft(values[span] * (taper / np.sqrt((taper**2).mean()))[:, None], axis=0)
        spectrum[np.fft.rfftfreq(n, 1.0 / record.rate_hz) > BAND_HZ] = 0.0
        out.append(np.fft.irfft(spectrum, n, axis=0))
    return np.concatenate(out)


def residual_of(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6)`` measured less predicted with a fit's effects and inertials, in band [N, N·m]."""
    return in_band(problem.record, explained_state(problem, fitted).residual)


def noise_floor(problem: Problem, below_hz: float = BAND_HZ) -> Array:
    """``(6,)`` standard deviation of the noise in band, from the noise model [N, N·m].

    Args:
        problem: the problem.
        below_hz: where it is asked for; the result is that of a band full of such noise.
    """
    total = np.zeros(6)
    for factor, span in zip(problem.whitening.factors, problem.record.spans, strict=True):
        covariance = np.linalg.inv(np.einsum("kji,kjl->kil", factor, factor))
        power = np.diagonal(covariance, axis1=1, axis2=2).copy()
        # All bins but the first stand for a real and an imaginary part, and for their mirror images.
        power[1:] *= 4.0
        low = np.fft.rfftfreq(span.stop - span.start, 1.0 / problem.record.rate_hz)[: len(power)] <= below_hz
        total += power[low].mean(axis=0) * len(power) / (span.stop - span.start)
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

    spread = _spread(problem, [total((fitted[span] ** 2).mean(axis=0)) ** 2 for span in record.spans])
    first, last = (total(power.mean(axis=0)) for power in powers)
    # Noise happens to be a little less than it is on average.
    floor = level * min(1.0, last / total(level**2))
    share = share_closed(first, last, total(floor**2))
    interval = None
    if after.placed:
        quietest = np.minimum(level, louder * np.minimum(learnt, _repeated(record, fitted))) ** 2
        freedom = sum(map(len, after.theta)) + float((problem.basis**2).sum())
        known = int((~problem.validation).sum() or len(problem.validation))
        # What parameters explain is as slow as motion, and there noise is less.
        slow = total(noise_floor(problem, _MOTION_HZ) ** 2) ** 2
        draws = []
        for _ in range(_DRAWS):
            pick = rng.integers(0, len(blocks), len(blocks))
            was, now = (total(power[pick].mean(axis=0)) for power in powers)
            power = quietest + rng.uniform() * (level**2 - quietest)
            quiet = min(total(power * max(0.0, 1.0 + spread * rng.standard_normal())), now)
            # What noise in the trials that were fitted did to the parameters is left in others, noise or not.
            uncertain = slow * rng.gamma(0.5 * freedom, 2.0 / known)
            uncertain *= np.exp(_UNCERTAIN_SPREAD * rng.standard_normal())
            draws.append(share_closed(was, float(np.sqrt(now**2 + uncertain)), quiet))
        low, high = (float(np.quantile(draws, p)) for p in (0.05, 0.95))
        interval = (min(low, share), max(high, share))
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
