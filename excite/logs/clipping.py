"""Samples at the end of a sensor's range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

_LEAST, _SHARE = 8, 0.002
# How much more often a clipped channel is at its extreme than at any value near it. A parabola's top level is met
# at most 2.4 times as often as the next.
_OFTEN = 4.0
_NEAR_LEVELS = 3
# Depth below the extreme at which an approach is judged, in steps or deviations of the noise, and how much deeper
# it is judged again. A straight approach takes four times as long from there, one that turns back or comes to rest
# twice, and 2.5 times where a step hides the top of a parabola.
_DEEP, _DEEPER = 4.0, 4.0
_STRAIGHT = 2.75
# Rows that an approach takes from the first depth.
_ROWS = 2
# A step so coarse that approaches are judged over more than this share of the range tells nothing: far away, all are
# alike.
_COARSEST = 0.1


def clipped_samples(values: Array, step: float, noise: float, moving: NDArray[np.bool_]) -> int:
    """Samples at the largest or smallest value of a channel, where that is the end of its range.

    A clipped channel is at its extreme much more often than next to it, and arrives there at speed. One that turns
    back is there as often as its resolution makes it, and one that comes to rest arrives slowly.

    Args:
        values: ``(n,)``.
        step: of a quantised channel, else 0, same unit.
        noise: standard deviation of the channel's noise, same unit.
        moving: ``(n,)`` rows in which the robot moves; at standstill any channel stays where it is.

    Returns:
        Their number; 0 where the channel is not clipped.
    """
    if values.max() == values.min():
        return 0
    depth = _DEEP * max(step, noise)
    return sum(_at_the_top(sign * values, step, depth, moving) for sign in (1.0, -1.0))


def _at_the_top(values: Array, step: float, depth: float, moving: NDArray[np.bool_]) -> int:
    below = values.max() - values
    at = (below < 0.5 * step) if step else (below == 0.0)
    count = int(np.sum(at & moving))
    if count < max(_LEAST, _SHARE * len(values)) or count < _OFTEN * _share_beside_extreme(
        below[moving], step
    ):
        return 0
    ways = [way for direction in (1, -1) for way in _ways_out(below[::direction], at[::direction])]
    starts = [way[_ROWS] for way in ways if len(way) > _ROWS]
    depth = max(depth, float(np.median(starts))) if starts else depth
    deep, deeper = depth + 0.5 * step, _DEEPER * depth + 0.5 * step
    if _DEEPER * _DEEP * step > _COARSEST * float(below.max()):
        return 0
    # A way that comes back before it is deep is part of what is at the top.
    times = np.array([[np.argmax(way > d) for d in (deep, deeper)] for way in ways if way.max() > deeper])
    if len(times) < 2:
        return 0
    short, long = times.sum(axis=0)
    return count if long > _STRAIGHT * short + 0.5 * np.sqrt(len(times)) else 0


def _ways_out(below: Array, at: NDArray[np.bool_]) -> list[Array]:
    """Distances from the extreme, from the row after it on, until the channel is back or the record ends."""
    out = np.flatnonzero(at[:-1] & ~at[1:]) + 1
    back = np.flatnonzero(at)
    ends = np.append(back, len(at))[np.searchsorted(back, out)]
    return [below[first:last] for first, last in zip(out, ends, strict=True)]


def _share_beside_extreme(below: Array, step: float) -> float:
    """How often the channel is at a value near its extreme: the most of the next levels, or of nearly all values."""
    if step:
        levels = np.rint(below / step)
        return float(max(np.sum(levels == k) for k in range(1, _NEAR_LEVELS + 1)))
    counts = np.unique(below[below > 0.0], return_counts=True)[1]
    return float(np.quantile(counts, 0.99)) if len(counts) else 0.0
