"""How much of a gap its effects leave, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.band import in_band
from excite.diagnosis.floating.equations.noise_level import noise_level
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.spectrum import BAND_HZ
from excite.diagnosis.floating.search.parameter_errors import left_by_parameters
from excite.diagnosis.floating.search.refinement import Fitted, explained_state

# Blocks are longer than what is left of a motion below a hertz remembers.
_BLOCK_S, _DRAWS, _ONE_SIDE = 2.0, 500, 0.05
_NEARLY_ALL, _SLOWEST_HZ = 0.97, 0.8
# Of a Gaussian, exceeded in one case of twenty.
_ONE_SIDED_STD = 1.64


@dataclass(frozen=True)
class Left:
    """What effects leave of a gap.

    Attributes:
        power: expected mean square over channels, each in units of its scale.
        interval: 90 % interval of its share of the gap's power.
    """

    power: float
    interval: tuple[float, float]


def what_is_left(
    problem: Problem,
    residuals: tuple[Array, Array],
    after: Fitted,
    scale: Array,
    judged: NDArray[np.bool_],
    rng: np.random.Generator,
) -> Left:
    """What effects leave on the trials that a gap is judged on, looked for where they explain something.

    Where it is told from noise, a block bootstrap over time and over the noise's level gives an interval of two
    sides. Where it is not, nothing speaks against a model that closes all: errors of the parameters are expected
    to leave what is left, and the interval has one side: nothing, and what nine draws of ten stay below.

    Args:
        problem: the problem.
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
    by_parameters = left_by_parameters(problem, after, scale, judged, rng, _DRAWS)
    share = np.minimum(1.0, np.maximum(left, by_parameters) / opened)
    if np.quantile(left, _ONE_SIDE) > 0.0 and _louder_than_noise(problem, after):
        low, high = np.quantile(share, [_ONE_SIDE, 1.0 - _ONE_SIDE])
        return Left(max(float(left.mean()), float(by_parameters.mean())), (float(low), float(high)))
    return Left(float(by_parameters.mean()), (0.0, float(np.quantile(share, 1.0 - 2.0 * _ONE_SIDE))))


def _louder_than_noise(problem: Problem, after: Fitted) -> bool:
    """Whether whitened numbers of the judged trials, too, are larger than independent ones of unit variance."""
    white = problem.rows(explained_state(problem, after))
    judged = white[problem.validation] if problem.validation.any() else white
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
