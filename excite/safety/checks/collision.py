"""Distance of every pair of bodies, at every instant and not only at samples."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import configuration_at
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, collision_shapes, geometry_data, pair_distance
from excite.safety.checks.approach import approach_rates
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# The search ends when the smallest distance is known to within COARSE, and FINE if the bound misses the
# margin.
_COARSE = 1e-3
_FINE = 1e-4
# Spacing of the first evaluations, of all pairs [s].
_FIRST_STEP = 0.1
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


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of the pairs of a robot's collision model along a motion."""

    sweep: Sweep

    @cached_property
    def geometry(self) -> pin.GeometryModel:
        """The robot's collision model."""
        return collision_model(self.sweep.robot)

    @cached_property
    def _data(self) -> tuple[pin.Data, pin.GeometryData]:
        return self.sweep.robot.model.createData(), geometry_data(self.geometry)

    @property
    def n_pairs(self) -> int:
        """Number of pairs."""
        return len(self.geometry.collisionPairs)

    @cached_property
    def _reach(self) -> Array:
        return approach_rates(self.sweep.robot.model, self.geometry)

    @cached_property
    def _travel(self) -> Array:
        """Way of each coordinate group since the start, at the fine grid's samples, ``(n, n_columns)``."""
        sweep = self.sweep
        speed = np.abs(sweep.control_points.velocity).max(axis=1)
        if sweep.robot.floating:
            h = np.diff(sweep.fine.time)[:, None]
            v, a = sweep.fine.v[:, :6].reshape(-1, 2, 3), sweep.fine.a[:, :6].reshape(-1, 2, 3)
            v_norm, a_norm = np.linalg.norm(v, axis=2), np.linalg.norm(a, axis=2)
            base = np.maximum(v_norm[:-1], v_norm[1:]) + h * np.maximum(a_norm[:-1], a_norm[1:])
            speed = np.hstack([base, speed])
        steps = speed * np.diff(sweep.fine.time)[:, None]
        return np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])

    def approach(self, start: float, end: float, pairs: NDArray[np.intp]) -> Array:
        """Bound on how much each pair's distance can change between two times, ``(n,)`` [m]."""
        return self._reach[pairs] @ (self._travel_at(end) - self._travel_at(start))

    @cached_property
    def _travelled(self) -> dict[float, Array]:
        """What :meth:`_travel_at` has been asked for: the search meets each instant in several intervals."""
        return {}

    def _travel_at(self, time: float) -> Array:
        known = self._travelled.get(time)
        if known is None:
            grid = self.sweep.fine.time
            k = min(max(int(grid.searchsorted(time, side="right")) - 1, 0), len(grid) - 2)
            share = (time - grid[k]) / (grid[k + 1] - grid[k])
            known = np.asarray((1.0 - share) * self._travel[k] + share * self._travel[k + 1])
            self._travelled[time] = known
        return known

    def at(self, time: float, pairs: NDArray[np.intp]) -> Array:
        """Distances of pairs at a time, ``(n,)`` [m], negative in penetration."""
        model_data, data = self._data
        robot = self.sweep.robot
        q = configuration_at(self.sweep.fine, robot, time)
        pin.updateGeometryPlacements(robot.model, model_data, self.geometry, data, q)
        return np.array([pair_distance(self.geometry, data, int(pair)) for pair in pairs])

    def midpoint(self, start: float, end: float) -> float:
        """A time between two others: a sample of the grid while there is one, else the middle."""
        grid = self.sweep.fine.time
        first, last = int(grid.searchsorted(start, side="right")), int(grid.searchsorted(end))
        return float(grid[(first + last - 1) // 2]) if last > first else 0.5 * (start + end)

    def first_below(self, pair: int, required: float, time: float, distance: float) -> Violation:
        """The violation of a pair at the first sample below the required distance, or at an instant known."""
        objects, chosen = self.geometry.geometryObjects, self.geometry.collisionPairs[pair]
        where = f"{objects[chosen.first].name} - {objects[chosen.second].name}"
        only = np.array([pair])
        for sample in self.sweep.fine.time:
            if sample >= time:
                break
            value = float(self.at(float(sample), only)[0])
            if value < required:
                return Violation("self_collision", float(sample), where, value, required)
        return Violation("self_collision", time, where, distance, required)


def find_closest(distances: Distances, required: float) -> Closest:
    """Smallest distance over all pairs and instants, and the pairs closer than ``required``."""
    grid = distances.sweep.fine.time
    n_first = max(2, int(np.ceil((grid[-1] - grid[0]) / _FIRST_STEP)) + 1)
    times = grid[np.unique(np.linspace(0, len(grid) - 1, min(n_first, len(grid))).round().astype(int))]
    everyone = np.arange(distances.n_pairs)
    values = [distances.at(float(time), everyone) for time in times]
    upper = min(float(row.min()) for row in values)
    found: dict[int, tuple[float, float]] = {}
    for time, row in zip(times, values, strict=True):
        _note(found, float(time), everyone, row, required)
    heap: list[tuple[float, int, float, float, NDArray[np.intp], Array, Array]] = []
    tie = count()

    def push(start: float, end: float, pairs: NDArray[np.intp], first: Array, last: Array) -> None:
        bound = 0.5 * (first + last - distances.approach(start, end, pairs))
        open_ = bound < upper
        if open_.any():
            entry = (
                float(bound[open_].min()),
                next(tie),
                start,
                end,
                pairs[open_],
                first[open_],
                last[open_],
            )
            heapq.heappush(heap, entry)

    for k in range(len(times) - 1):
        push(float(times[k]), float(times[k + 1]), everyone, values[k], values[k + 1])
    for _ in range(_MAX_EVALUATIONS):
        if not heap or _settled(heap[0][0], upper, required):
            break
        _, _, start, end, pairs, first, last = heapq.heappop(heap)
        middle = distances.midpoint(start, end)
        row = distances.at(middle, pairs)
        upper = min(upper, float(row.min()))
        _note(found, middle, pairs, row, required)
        push(start, middle, pairs, first, row)
        push(middle, end, pairs, row, last)
    return Closest(min(heap[0][0], upper) if heap else upper, upper, found)


def _settled(lower: float, upper: float, required: float) -> bool:
    gap = upper - lower
    return gap <= _FINE or (gap <= _COARSE and (lower >= required or upper < required))


def _note(
    found: dict[int, tuple[float, float]], time: float, pairs: NDArray[np.intp], row: Array, required: float
) -> None:
    for pair, value in zip(pairs[row < required], row[row < required], strict=True):
        if int(pair) not in found or time < found[int(pair)][0]:
            found[int(pair)] = (time, float(value))
