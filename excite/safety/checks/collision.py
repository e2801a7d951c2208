"""Distance of every pair of bodies, at every instant and not only at samples."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.distances import Distances
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# The search ends when the smallest distance is known to within COARSE, and FINE if the bound misses the
# margin.
_COARSE = 1e-3
_FINE = 1e-4
# Spacing of the first evaluations, of all pairs [s].
_FIRST_STEP = 0.1
# Pairs whose distances are asked for together in the first evaluations.
_TOGETHER = 32
# Evaluations of the robot's geometry after which the search gives up, undecided.
_MAX_EVALUATIONS = 20_000


@dataclass(frozen=True, eq=False)
class Closest:
    """Outcome of the search for the smallest distance.

    Attributes:
        lower: no pair comes closer than this at any instant [m].
        upper: smallest distance found at an instant [m].
        found: by pair that came closer than the required distance: time [s] and distance [m] of its earliest
            evaluation that shows it.
    """

    lower: float
    upper: float
    found: dict[int, tuple[float, float]]


class SelfCollisionCheck(Check):
    """Bodies keep the distance that ``collision.margin`` of the robot asks for.

    The margin is a lower bound of the smallest distance over all pairs and all instants, 1 mm below it at
    most. It is found by branch and bound on time (Piyavskii 1972; Shubert 1972, eq. 2.3): between instants
    with distances d₀ and d₁ no pair comes closer than ``(d₀ + d₁ − s)/2``, where s bounds how far the joints
    between its two bodies can move any point of one body relative to the other in that time
    (:func:`~excite.safety.checks.approach.approach_rates`). Joint speeds between samples are bounded by the
    Bézier control points of the interpolant, so for joints the bound holds exactly, up to coal's tolerance of
    1e-6 m. A free base matters only for pairs with the world; for them the bound neglects what the
    interpolant leaves out, terms of third order in the base's rotation within a step.

    A motion that collides is reported with the pairs that the search met, not necessarily all of them. A
    search that ends undecided leaves the margin None. It means nothing for a robot each of whose moving bodies has a
    shape and no two of which need stay apart: a pendulum's touch at their joints alone.
    """

    name: ClassVar[str] = "self_collision"
    margin_field: ClassVar[str | None] = "self_collision_m"

    def judge(self, sweep: Sweep) -> CheckResult:
        required = sweep.robot.description.collision.margin
        distances = Distances(sweep)
        if not distances.n_pairs:
            if _all_have_shapes(sweep.robot):
                return CheckResult(applicable=False)
            return CheckResult(violations=(Violation("no_collision_pairs", None, "collision", None, None),))
        closest = find_closest(distances, required)
        if closest.found:
            firsts = [
                distances.first_below(pair, required, *event) for pair, event in sorted(closest.found.items())
            ]
            return CheckResult(closest.upper, tuple(firsts))
        return CheckResult(closest.lower if closest.lower >= required else None)


def _all_have_shapes(robot: Robot) -> bool:
    return {segment.joint for segment in robot.segments} <= {shape.joint for shape in collision_shapes(robot)}


def find_closest(distances: Distances, required: float) -> Closest:
    """Smallest distance over all pairs and instants, and the pairs closer than ``required``."""
    grid = distances.sweep.fine.time
    n_first = max(2, int(np.ceil((grid[-1] - grid[0]) / _FIRST_STEP)) + 1)
    times = grid[np.unique(np.linspace(0, len(grid) - 1, min(n_first, len(grid))).round().astype(int))]
    first = _first_look(distances, times, required)
    upper, found = first.upper, first.found
    heap: list[tuple[float, int, float, float, NDArray[np.intp], Array, Array]] = []
    tie = count()

    def push(start: float, end: float, pairs: NDArray[np.intp], before: Array, after: Array) -> None:
        bound = 0.5 * (before + after - distances.approach(start, end, pairs))
        # Few pairs are left in most intervals: numbers of a list are compared sooner than those of an array.
        bounds = bound.tolist()
        least = min(bounds, default=np.inf)
        if least >= upper:
            return
        if len(bounds) > 1 and max(bounds) >= upper:
            open_ = bound < upper
            pairs, before, after = pairs[open_], before[open_], after[open_]
        heapq.heappush(heap, (least, next(tie), start, end, pairs, before, after))

    for k in range(len(times) - 1):
        pairs = np.flatnonzero(first.asked[k] & first.asked[k + 1])
        push(float(times[k]), float(times[k + 1]), pairs, first.values[k, pairs], first.values[k + 1, pairs])
    for _ in range(_MAX_EVALUATIONS):
        if not heap or _is_settled(heap[0][0], upper, required):
            break
        _, _, start, end, pairs, before, after = heapq.heappop(heap)
        middle = distances.midpoint(start, end)
        row = distances.at(middle, pairs)
        least = min(row.tolist())
        upper = min(upper, least)
        if least < required:
            _note_distance(found, middle, pairs, row, required)
        push(start, middle, pairs, before, row)
        push(middle, end, pairs, row, after)
    return Closest(min(heap[0][0], upper) if heap else upper, upper, found)


@dataclass(frozen=True, eq=False)
class _FirstLook:
    """Distances at the instants that the search begins with.

    Attributes:
        values: ``(n, n_pairs)`` distances where they were asked for, else bounds from below [m].
        asked: ``(n, n_pairs)`` where.
        upper: the smallest distance [m].
        found: as in :class:`Closest`.
    """

    values: Array
    asked: NDArray[np.bool_]
    upper: float
    found: dict[int, tuple[float, float]]


def _first_look(distances: Distances, times: Array, required: float) -> _FirstLook:
    """Distances at some instants of all pairs but those that bounds show to be far, at them and between them.

    What is left out could neither be the smallest distance, nor too small, nor be looked at again.
    """
    values, ways = distances.at_least(times), distances.ways(times)
    asked = np.zeros(values.shape, dtype=bool)
    upper, found = np.inf, dict[int, tuple[float, float]]()
    for k, time in enumerate(times):
        # What an instant may hold, and an interval, as its ends have to be asked for it.
        lowest = values[k].copy()
        if k > 0:
            np.maximum(lowest, values[k - 1] - ways[k - 1], out=lowest)
            values[k] = lowest
            lowest = np.minimum(lowest, 0.5 * (values[k - 1] + lowest - ways[k - 1]))
        if k < len(ways):
            # The next instant's distance is no less than what this one's leaves of it.
            after = np.maximum(values[k + 1], values[k] - ways[k])
            lowest = np.minimum(lowest, 0.5 * (values[k] + after - ways[k]))
        open_ = np.flatnonzero((lowest < upper) | (values[k] < required))
        nearest = open_[np.argsort(lowest[open_], kind="stable")]
        for start in range(0, len(nearest), _TOGETHER):
            # Those that are asked for first may show that the others are farther than the closest so far.
            few = nearest[start : start + _TOGETHER]
            pairs = few[(lowest[few] < upper) | (values[k, few] < required)]
            if not len(pairs):
                continue
            row = distances.at(float(time), pairs)
            values[k, pairs], asked[k, pairs] = row, True
            upper = min(upper, float(row.min()))
            _note_distance(found, float(time), pairs, row, required)
    return _FirstLook(values, asked, upper, found)


def _is_settled(lower: float, upper: float, required: float) -> bool:
    gap = upper - lower
    return gap <= _FINE or (gap <= _COARSE and (lower >= required or upper < required))


def _note_distance(
    found: dict[int, tuple[float, float]], time: float, pairs: NDArray[np.intp], row: Array, required: float
) -> None:
    for pair, value in zip(pairs.tolist(), row.tolist(), strict=True):
        if value < required and (pair not in found or time < found[pair][0]):
            found[pair] = (time, value)
