"""Distance of every pair of bodies, at every instant and not only at samples."""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import count

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Flags
from excite.motion.motion import Instants
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.robot.shapes.collision import (
    bounding_balls,
    collision_shapes,
    geometry_data,
    pair_distance,
    watched_model,
)
from excite.safety.checks.base import CheckResult
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


def judge_self_collision(sweep: Sweep) -> CheckResult:
    """Bodies keep the distance that ``collision.margin`` of the robot asks for.

    The margin is a lower bound of the smallest distance over all pairs and all instants, 1 mm below it at
    most. It is found by branch and bound on time (Piyavskii 1972; Shubert 1972, eq. 2.3): between instants
    with distances d₀ and d₁ no pair comes closer than ``(d₀ + d₁ − s)/2``, where s bounds how far the joints
    between its two bodies can move any point of one body relative to the other in that time
    (:func:`~excite.safety.checks.collision.approach_rates`). Joint speeds between samples are bounded by the
    Bézier control points of the interpolant, so for joints the bound holds exactly, up to coal's tolerance of
    1e-6 m. A free base matters only for pairs with the world; for them the bound neglects what the
    interpolant leaves out, terms of third order in the base's rotation within a step.

    A motion that collides is reported with the pairs that the search met, not necessarily all of them. A
    search that ends undecided leaves the margin None. It means nothing for a robot each of whose moving bodies has a
    shape and no two of which need stay apart: a pendulum's touch at their joints alone.
    """
    required = sweep.robot.description.collision.margin
    distances = Distances(sweep)
    if not distances.n_pairs:
        shaped = {shape.joint for shape in collision_shapes(sweep.robot)}
        if {segment.joint for segment in sweep.robot.segments} <= shaped:
            return CheckResult(applicable=False)
        return CheckResult(violations=(Violation("no_collision_pairs", None, "collision", None, None),))
    closest = find_closest(distances, required)
    if closest.found:
        firsts = [
            distances.first_below(pair, required, *event) for pair, event in sorted(closest.found.items())
        ]
        return CheckResult(closest.upper, tuple(firsts))
    return CheckResult(closest.lower if closest.lower >= required else None)


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
    asked: Flags
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


# Distances of a robot's bodies along a motion, and how fast they can change.

# Coal knows a distance to within 1e-6 m: bounds that are compared with distances give way by more.
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class _Bodies:
    """What holds of the pairs of a robot's collision model in any motion.

    Attributes:
        rates: of approach, ``(n_pairs, n_columns)`` (:func:`~excite.safety.checks.collision.approach_rates`).
        centres: of balls about the bodies, in their own frames, ``(n_bodies, 3)`` [m].
        first: index of each pair's one body, ``(n_pairs,)``.
        second: of its other.
        reach: radii of the pair's balls together, and what distances may be off by, ``(n_pairs,)`` [m].
        spare: what the margin is more than the distance that each pair keeps, ``(n_pairs,)`` [m].
        data: where they are, of which no answer depends on what was asked before; 4 ms to make of G1's 505 pairs.
    """

    rates: Array
    centres: Array
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    reach: Array
    spare: Array
    data: pin.GeometryData


@lru_cache(maxsize=4)
def _collision_bodies(robot: Robot) -> _Bodies:
    geometry, kept = watched_model(robot)
    centres, radii = bounding_balls(geometry)
    first = np.array([pair.first for pair in geometry.collisionPairs], dtype=np.intp)
    second = np.array([pair.second for pair in geometry.collisionPairs], dtype=np.intp)
    rates = approach_rates(robot.model, geometry)
    reach = radii[first] + radii[second] + _TOLERANCE
    spare = robot.description.collision.margin - kept
    return _Bodies(rates, centres, first, second, reach, spare, geometry_data(geometry))


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of the pairs of a robot's collision model along a motion.

    Those of a pair that keeps a distance of its own in place of the margin count from there: as much as the margin is
    more than that is added to them.
    """

    sweep: Sweep

    @cached_property
    def geometry(self) -> pin.GeometryModel:
        """The robot's collision model."""
        return watched_model(self.sweep.robot)[0]

    @cached_property
    def _data(self) -> tuple[pin.Data, pin.GeometryData]:
        return self.sweep.robot.model.createData(), _collision_bodies(self.sweep.robot).data

    @cached_property
    def _instants(self) -> Instants:
        return Instants(self.sweep.fine, self.sweep.robot)

    @cached_property
    def _times(self) -> list[float]:
        """The fine grid; a list is searched for one time in a fifth of the time that an array takes."""
        times: list[float] = self.sweep.fine.time.tolist()
        return times

    @property
    def n_pairs(self) -> int:
        """Number of pairs."""
        return len(self.geometry.collisionPairs)

    @cached_property
    def _travel(self) -> Array:
        """Way of each coordinate group since the start, at the fine grid's samples, ``(n, n_columns)``."""
        sweep = self.sweep
        speed = sweep.bounds.speed
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
        known = self._travelled
        first, last = known.get(start), known.get(end)
        first = self._travel_at(start) if first is None else first
        last = self._travel_at(end) if last is None else last
        return _collision_bodies(self.sweep.robot).rates[pairs] @ (last - first)

    def ways(self, times: Array) -> Array:
        """Bounds on how much all pairs' distances can change between one time and the next, ``(n - 1, n_pairs)`` [m].

        They are a little wider than those of :meth:`approach`, by what distances may be off.
        """
        travel = np.array([self._travel_at(float(time)) for time in times])
        return np.asarray(np.diff(travel, axis=0) @ _collision_bodies(self.sweep.robot).rates.T + _TOLERANCE)

    @cached_property
    def _travelled(self) -> dict[float, Array]:
        """What :meth:`_travel_at` has found: the search meets each instant in several intervals."""
        return {}

    def _travel_at(self, time: float) -> Array:
        times, travel = self._times, self._travel
        k = min(max(bisect_right(times, time) - 1, 0), len(times) - 2)
        if times[k] == time:
            found = np.asarray(travel[k])
        else:
            share = (time - times[k]) / (times[k + 1] - times[k])
            found = np.asarray((1.0 - share) * travel[k] + share * travel[k + 1])
        self._travelled[time] = found
        return found

    def at(self, time: float, pairs: NDArray[np.intp]) -> Array:
        """Distances of pairs at a time, ``(n,)`` [m], negative in penetration."""
        data = self._placed(time)
        apart = np.array([pair_distance(self.geometry, data, pair) for pair in pairs.tolist()])
        return np.asarray(apart + _collision_bodies(self.sweep.robot).spare[pairs])

    def at_least(self, times: Array) -> Array:
        """Bounds of all pairs' distances from below at some times, ``(n, n_pairs)`` [m]: of balls about the bodies."""
        bodies = _collision_bodies(self.sweep.robot)
        # Views of what pinocchio fills in at each time.
        placed = [(placement.rotation, placement.translation) for placement in self._data[1].oMg]
        rotation, position = np.empty((len(times), len(placed), 3, 3)), np.empty((len(times), len(placed), 3))
        for k, time in enumerate(times):
            self._placed(float(time))
            for i, (turned, moved) in enumerate(placed):
                rotation[k, i], position[k, i] = turned, moved
        points = np.einsum("nkij,kj->nki", rotation, bodies.centres) + position
        apart = points[:, bodies.first] - points[:, bodies.second]
        return np.asarray(np.sqrt(np.einsum("npi,npi->np", apart, apart)) - bodies.reach + bodies.spare)

    def _placed(self, time: float) -> pin.GeometryData:
        """The bodies where they are at a time."""
        model_data, data = self._data
        robot = self.sweep.robot
        q = self._instants.at(time)
        pin.updateGeometryPlacements(robot.model, model_data, self.geometry, data, q)
        return data

    def midpoint(self, start: float, end: float) -> float:
        """A time between two others: a sample of the grid while there is one, else the middle."""
        times = self._times
        first, last = bisect_right(times, start), bisect_left(times, end)
        return times[(first + last - 1) // 2] if last > first else 0.5 * (start + end)

    def first_below(self, pair: int, required: float, time: float, distance: float) -> Violation:
        """The violation of a pair at the first sample below the required distance, or at an instant known."""
        objects, chosen = self.geometry.geometryObjects, self.geometry.collisionPairs[pair]
        where = f"{objects[chosen.first].name} - {objects[chosen.second].name}"
        only, spare = np.array([pair]), float(_collision_bodies(self.sweep.robot).spare[pair])
        for sample in self.sweep.fine.time:
            if sample >= time:
                break
            value = float(self.at(float(sample), only)[0])
            if value < required:
                time, distance = float(sample), value
                break
        return Violation("self_collision", time, where, distance - spare, required - spare)


# How fast two bodies of a robot can approach each other, whatever its configuration.


def approach_rates(model: pin.Model, geometry: pin.GeometryModel) -> Array:
    """Largest rate at which each joint changes the distance of each pair, per unit of its speed.

    Only joints on the way from one body to the other count. A revolute joint at 1 rad/s moves the farthest
    point of the body beyond it by no more than its distance from the joint's origin, in m/s, and that is at
    most the sum of the links between and the body's own radius; a prismatic joint by 1. A free base has two
    columns: its linear speed with rate 1, its angular speed with the distance.

    Args:
        model: pinocchio model of joints with one coordinate, the first possibly a free-flyer.
        geometry: its collision model with pairs.

    Returns:
        ``(n_pairs, n_columns)``, one column a joint in model order, two for a free base [m/rad or 1].
    """
    rates = np.array([_body_rates(model, shape) for shape in geometry.geometryObjects])
    ancestors = np.array([_columns_above(model, shape.parentJoint) for shape in geometry.geometryObjects])
    first = np.array([pair.first for pair in geometry.collisionPairs], dtype=int)
    second = np.array([pair.second for pair in geometry.collisionPairs], dtype=int)
    between = ancestors[first] != ancestors[second]
    return np.asarray((rates[first] + rates[second]) * between)


def _first_column(model: pin.Model, joint: int) -> int:
    """First column of a joint."""
    free = model.nvs[1] == 6
    return joint if free and joint > 1 else joint - 1


def _columns_above(model: pin.Model, joint: int) -> Array:
    above = np.zeros(_n_columns(model), dtype=bool)
    for ancestor in list(model.supports[joint])[1:]:
        above[_first_column(model, ancestor)] = True
        if model.nvs[ancestor] == 6:
            above[1] = True
    return above


def _n_columns(model: pin.Model) -> int:
    return int(model.njoints - 1 + (1 if model.nvs[1] == 6 else 0))


def _body_rates(model: pin.Model, shape: pin.GeometryObject) -> Array:
    """Rates by which the joints above a body move its points, zero for the others."""
    local = shape.geometry
    local.computeLocalAABB()
    reach = float(np.linalg.norm(shape.placement.act(local.aabb_center)) + local.aabb_radius)
    rates = np.zeros(_n_columns(model))
    for joint in reversed(list(model.supports[shape.parentJoint])[1:]):
        column = _first_column(model, joint)
        prismatic = model.nvs[joint] == 1 and is_prismatic(model, model.idx_vs[joint])
        if model.nvs[joint] == 6:
            rates[column], rates[column + 1] = 1.0, reach
            continue
        rates[column] = 1.0 if prismatic else reach
        if prismatic:
            q = model.idx_qs[joint]
            reach += max(abs(model.lowerPositionLimit[q]), abs(model.upperPositionLimit[q]))
        reach += float(np.linalg.norm(model.jointPlacements[joint].translation))
    return rates
