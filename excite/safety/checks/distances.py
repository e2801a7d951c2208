"""Distances of a robot's bodies along a motion, and how fast they can change."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import Instants
from excite.robot.robot import Robot
from excite.robot.shapes.collision import bounding_balls, geometry_data, pair_distance, watched_model
from excite.safety.checks.approach import approach_rates
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# Coal knows a distance to within 1e-6 m: bounds that are compared with distances give way by more.
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class _Bodies:
    """What holds of the pairs of a robot's collision model in any motion.

    Attributes:
        rates: of approach, ``(n_pairs, n_columns)`` (:func:`~excite.safety.checks.approach.approach_rates`).
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
