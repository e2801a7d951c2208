"""How far the gap shrinks on the validation trials, wrench component by component."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.floating.equations.band import in_band
from excite.diagnosis.floating.equations.noise_level import noise_level
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.left import what_is_left
from excite.diagnosis.floating.search.refinement import Fitted, explained_state
from excite.logs.columns import WRENCH_AXES

UNITS = ("N",) * 3 + ("N·m",) * 3


def residual_of(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6)`` measured less predicted with a fit's effects and inertials, in band [N, N·m]."""
    return in_band(problem.record, explained_state(problem, fitted).residual)


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
    residuals = (residual_of(problem, before), residual_of(problem, after))
    old, new = (residual[rows] for residual in residuals)
    first, last = (float(((x / scale) ** 2).mean()) for x in (old, new))
    noise = noise_level(problem, residuals[1], scale, rows)
    level = noise.likely
    loud, least = (float(((x / scale) ** 2).mean()) for x in (level, noise.least))
    # Noise happens to be a little less, or more, than it is on average.
    left = what_is_left(problem, residuals, after, scale, rows, rng) if after.placed else None
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
            UNITS[i],
        )
        for i, axis in enumerate(WRENCH_AXES)
    }
    return Gap(start, end, noise_size, share, channels, interval)
