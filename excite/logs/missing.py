"""Rows that a record lacks: steps of its stamps that are whole periods too long."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

# Rows on either side over which stamps are averaged: jitter of single stamps averages out, a hiccup of one does too.
_WINDOWS = (1, 2, 4, 8)
# No clock is better than this share of a period for the choice of a window.
_FINE = 0.1
_PASSES = 12
# Half a window of rows on one side makes means so much less certain.
_AT_END = 1.5
# So few odd steps are no tail.
_FEW = 20
# Index of the window that tells a change of level from a single late stamp.
_LEVEL = 2
# Rows that a record lacks before any is found to be missing, for the odds.
_RARE = 0.1


def missing_rows(time: Array) -> NDArray[np.int64]:
    """How many rows are missing in each step between stamps.

    Where a row is missing, all later stamps are a period further than their number lets one expect. That change
    of level is looked for between means over some rows on either side, as many as make it clearest: jitter of
    single stamps averages out over many rows, a clock that wanders is judged by single steps. A row counts as
    missing where that is likelier than the spread of the other steps, both taken as normal and the share of gaps
    as found. What later stamps make up for, as those of packets that waited and came in a burst, is no gap.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].

    Returns:
        ``(n - 1,)`` rows missing between a stamp and the next.
    """
    step = np.diff(time)
    period = float(np.median(step))
    extra = np.zeros(len(step), dtype=np.int64)
    if np.abs(step - period).max() < 0.5 * period:
        return extra
    spreads = [_robust_deviation(_stamp_jumps(step, w)[0]) for w in _WINDOWS]
    best = int(np.argmin(np.maximum(spreads, _FINE * period)))
    if _long_tailed(step, period, _WINDOWS[best]):
        # Loops that are held up for part of a period: no single row can be told to be missing.
        return np.where(step > 2.5 * period, np.rint(step / period) - 1, 0).astype(np.int64)
    extra = _added_rows(step, period, extra, _WINDOWS[best])
    if best < _LEVEL and spreads[_LEVEL] < 0.2 * period:
        # A single stamp that is late, next to none that are, is a long step and no change of level.
        extra = _added_rows(step, period, extra, _WINDOWS[_LEVEL])
    behind = np.cumsum(extra)
    kept = np.minimum.accumulate(behind[::-1])[::-1]
    return np.diff(np.concatenate([[0], np.maximum(kept, 0)]))


def _long_tailed(step: Array, period: float, window: int) -> bool:
    """Whether jumps of half a period are so many more than normal ones would be that those of one are their tail.

    Gaps are jumps of whole periods: where rows are missing, there are more of these than between.
    """
    jump = _stamp_jumps(step, window)[0] / period
    spread = max(_robust_deviation(jump), 1e-9)
    between, whole = (
        int(np.sum((np.abs(jump - middle) < 0.1) & (jump == _highest_near(jump, window))))
        for middle in (0.5, 1.0)
    )
    tail = [math.erfc(edge / (spread * math.sqrt(2.0))) for edge in (0.4, 0.6)]
    return between - 0.5 * len(step) * (tail[0] - tail[1]) > max(whole, _FEW)


def _added_rows(step: Array, period: float, extra: NDArray[np.int64], window: int) -> NDArray[np.int64]:
    """Rows missing in each step, from those found before and jumps of the level that they leave."""
    extra = extra.copy()
    for _ in range(_PASSES):
        jump, weight = _stamp_jumps(step - period * extra, window)
        spread = max(_robust_deviation(jump), 1e-9 * period)
        share = min(0.5, max(_RARE, int(np.abs(extra).sum())) / len(step))
        limit = period * (0.5 + (spread / period) ** 2 * weight * np.log(1.0 / share - 1.0))
        # So near an end one late stamp is all that there is.
        size = np.where(weight > _AT_END, 0.0, np.abs(jump))
        found = np.flatnonzero((size > limit) & (size == _highest_near(size, window)))
        # Of jumps that are equally high the first is enough.
        found = found[np.concatenate([[True], np.diff(found) > window])] if len(found) else found
        change = np.rint(jump[found] / period).astype(np.int64)
        if not change.any():
            break
        more = change > 0
        reach = window // 2
        np.add.at(extra, _largest_near(step - period * extra, found[more], reach), change[more])
        # What was no gap is taken back where it was added.
        np.add.at(extra, _largest_near(extra, found[~more], reach), change[~more])
    return extra


def _stamp_jumps(step: Array, window: int) -> tuple[Array, Array]:
    """By how much stamps after each step are further than those before it, beyond the usual step [s].

    Also by how much the variance of the means exceeds that of full windows, near the ends.
    """
    n = len(step) + 1
    level = np.concatenate([[0.0], np.cumsum(step - np.median(step))])
    total = np.concatenate([[0.0], np.cumsum(level)])
    middle = np.arange(1, n)
    first, last = np.maximum(middle - window, 0), np.minimum(middle + window, n)
    before = (total[middle] - total[first]) / (middle - first)
    after = (total[last] - total[middle]) / (last - middle)
    jump = after - before
    weight = (1.0 / (middle - first) + 1.0 / (last - middle)) / (2.0 / window)
    return jump - np.median(jump), weight


def _robust_deviation(values: Array) -> float:
    """Standard deviation by the median absolute deviation: gaps are few."""
    return 1.4826 * float(np.median(np.abs(values)))


def _largest_near(
    values: Array | NDArray[np.int64], places: NDArray[np.intp], reach: int
) -> NDArray[np.intp]:
    """Where, up to ``reach`` places from each place, the largest value is."""
    near = np.clip(places[:, None] + np.arange(-reach, reach + 1), 0, len(values) - 1)
    return np.asarray(near[np.arange(len(places)), np.argmax(values[near], axis=1)])


def _highest_near(values: Array, reach: int) -> Array:
    """Highest value up to ``reach`` places away on either side."""
    padded = np.pad(values, reach, constant_values=-np.inf)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1))
