"""How loud the noise is in the trials that a gap is judged on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.spectrum import BAND_HZ, in_band
from excite.diagnosis.floating.search.ranking import NOISE_SLACK

# Noise has few independent numbers in a band of a few hertz, and trials as short as these.
_LEAST_SPREAD, _LARGEST_SPREAD = 0.12, 0.3
_UPPER_END_HZ = 2.4
_LOUDER_STD, _LOUDER_RANGE = 0.06, (0.7, 1.5)


@dataclass(frozen=True, eq=False)
class NoiseLevel:
    """Noise of the wrench's components below a frequency, in the trials that a gap is judged on.

    Attributes:
        likely: ``(6,)`` standard deviation [N, N·m].
        least: ``(6,)`` the least that it may be.
        spread: how far its power may be from either, relative.
    """

    likely: Array
    least: Array
    spread: float


def noise_level(
    problem: Problem, residual: Array, scale: Array, judged: NDArray[np.bool_], below_hz: float = BAND_HZ
) -> NoiseLevel:
    """Noise as far as the model of it, what a fit leaves of the other trials and repeated trials tell.

    Args:
        problem: the problem.
        residual: ``(n, 6)`` what the fit leaves, in band [N, N·m].
        scale: ``(6,)`` of the channels.
        judged: ``(n,)`` which samples the gap is judged on.
        below_hz: where the noise is asked for.
    """
    record = problem.record
    louder = _louder(record, residual / scale)
    slow, learnt = in_band(record, residual, below_hz), noise_floor(problem, below_hz)
    fitted = ~judged if (~judged).any() else judged
    # What is left in the trials that were fitted says how loud the noise is, as far as noise can be that loud.
    seen = np.sqrt((slow[fitted] ** 2).mean(axis=0))
    likely = louder * np.minimum(seen, np.sqrt(NOISE_SLACK) * learnt)
    least = np.minimum(likely, louder * np.minimum(learnt, _repeated(record, slow)))
    powers = [float(((slow[span] / scale) ** 2).mean()) for span in record.spans]
    # Independent numbers that the level is learnt from: a noise of that band in as many channels as carry it.
    share = (likely / scale) ** 2
    channels = float(share.sum() ** 2 / (share**2).sum())
    numbers = 2.0 * below_hz * channels * int(fitted.sum()) / record.rate_hz
    return NoiseLevel(likely, least, float(np.hypot(_spread(problem, powers), np.sqrt(2.0 / numbers))))


def noise_floor(problem: Problem, below_hz: float = BAND_HZ) -> Array:
    """``(6,)`` standard deviation of the noise in band, below a frequency, from the noise model [N, N·m]."""
    total = np.zeros(len(problem.nominal.white_noise))
    for factor, span in zip(problem.whitening.factors, problem.record.spans, strict=True):
        covariance = np.linalg.inv(np.einsum("kji,kjl->kil", factor, factor))
        power = np.diagonal(covariance, axis1=1, axis2=2).copy()
        # All bins but the first stand for a real and an imaginary part, and for their mirror images.
        power[1:] *= 4.0
        low = np.fft.rfftfreq(span.stop - span.start, 1.0 / problem.record.rate_hz)[: len(power)] <= below_hz
        total += power[low].sum(axis=0) / (span.stop - span.start)
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
    return np.sqrt(np.mean(powers, axis=0)) if powers else np.full(residual.shape[1], np.inf)
