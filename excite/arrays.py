"""The types of arrays that signatures name.

A module of its own, free of other imports, so that filters and readers do not load the robot's libraries for a name.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# Binary digits that a whole number of numpy's has room for.
_DIGITS = 62


class Moved(NamedTuple):
    """Where something is and how it moves, in the same rows.

    Attributes:
        q: configurations, or positions.
        v: velocities.
        a: accelerations.
    """

    q: Array
    v: Array
    a: Array


def distinct_rows(flags: Flags) -> tuple[Flags, NDArray[np.intp]]:
    """Distinct rows of booleans ``(n, m)``, in rising order, and which of them each row is, ``(n,)``.

    Each row is made one number: numpy takes ten times as long to tell rows of an array apart.
    """
    if flags.shape[1] > _DIGITS:
        rows, member = np.unique(flags, axis=0, return_inverse=True)
        return rows, member.ravel()
    numbers = flags @ (1 << np.arange(flags.shape[1])[::-1])
    _, first, member = np.unique(numbers, return_index=True, return_inverse=True)
    return flags[first], member


def widen_flags(flags: Flags, around: int) -> Flags:
    """Rows of ``flags (n, …)`` with a flag among so many before and after, each column by itself, likewise."""
    padded = np.pad(flags, [(around + 1, around), *[(0, 0)] * (flags.ndim - 1)])
    count, width = np.cumsum(padded, axis=0), 2 * around + 1
    return np.asarray(count[width:] > count[:-width])


def jackknife_std(values: Array) -> Array:
    """Standard deviations of estimates ``(n, …)`` that leave out one part of the data each (Miller 1974)."""
    n = len(values)
    return np.asarray(np.sqrt(max(n - 1, 0) * values.var(axis=0))) if n else np.zeros(values.shape[1:])


def is_whole(values: Array) -> bool:
    """Whether all numbers are whole."""
    return bool((values == np.round(values)).all())


def runs_of(flags: Flags) -> list[tuple[int, int]]:
    """First place of each run of True in ``flags (n,)``, and the one behind its last."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def assign_rows(costs: Array) -> NDArray[np.intp]:
    """The column of each row in the assignment of all rows to different columns that costs least in all.

    Where the rows' cheapest columns differ, they are it; elsewhere scipy tells, which takes .1 s to import.

    Args:
        costs: ``(n, n)``, finite.
    """
    cheapest = costs.argmin(axis=1)
    if len(np.unique(cheapest)) == len(costs):
        return cheapest
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(costs)[1])
