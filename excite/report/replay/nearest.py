"""The nearest pair of a robot's bodies, without the distances of those that cannot be it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot
from excite.robot.shapes.collision import bounding_balls, collision_model
from excite.safety.checks.approach import approach_rates

# Coal knows a distance to within 1e-6 m: what is kept of one gives way by more.
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class _Bodies:
    """What holds in all motions of a robot; 3 ms of G1's 505 pairs.

    Attributes:
        rates: at which pairs approach, ``(n_pairs, n_rates)``.
        centres: of spheres about the bodies, each with the joint that carries it and in its frame [m].
        ends: of each pair, ``(n_pairs, 2)``.
        reach: radii of its spheres together, ``(n_pairs,)`` [m].
    """

    rates: Array
    centres: tuple[tuple[int, Array], ...]
    ends: NDArray[np.intp]
    reach: Array


@lru_cache(maxsize=1)
def _collision_bodies(robot: Robot) -> _Bodies:
    geometry = collision_model(robot)
    centres, radii = bounding_balls(geometry)
    ends = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.intp)
    placed = zip(geometry.geometryObjects, centres, strict=True)
    return _Bodies(
        approach_rates(robot.model, geometry),
        tuple((shape.parentJoint, np.asarray(shape.placement.act(centre))) for shape, centre in placed),
        ends,
        radii[ends].sum(axis=1),
    )


def nearest_pairs(robot: Robot, data: pin.Data, found: pin.GeometryData, q: Array) -> Iterator[int]:
    """The pair of least distance in one posture after the other.

    No distance is computed of pairs that spheres about their bodies keep further apart than another pair is, nor of
    those that were so far apart that they cannot have come as near since.

    Args:
        robot: with at least one pair of bodies that may touch.
        data: of its model.
        found: of its collision model; placements and the pair's result are those of the posture when a pair comes.
        q: ``(n, nq)``, the postures, neighbours alike.
    """
    geometry = collision_model(robot)
    apart, come_nearer = _kept_apart(robot, q), _posture_steps(robot, q) @ _collision_bodies(robot).rates.T
    least, nearest = np.full(apart.shape[1], -np.inf), 0
    for k, posture in enumerate(q):
        pin.updateGeometryPlacements(robot.model, data, geometry, found, posture)
        if k:
            least -= come_nearer[k - 1]
        np.maximum(least, apart[k], out=least)
        # The pair that was nearest before is near still, and few can be nearer.
        best = float(pin.computeDistance(geometry, found, nearest).min_distance)
        least[nearest] = best - _TOLERANCE
        open_ = np.flatnonzero(least < best)
        for pair in open_[np.argsort(least[open_])].tolist():
            if least[pair] >= best:
                break
            if pair == nearest:
                continue
            distance = float(pin.computeDistance(geometry, found, pair).min_distance)
            least[pair] = distance - _TOLERANCE
            if distance < best:
                best, nearest = distance, pair
        yield nearest


def _kept_apart(robot: Robot, q: Array) -> Array:
    """Least distances of all pairs by the spheres about their bodies, ``(n, n_pairs)`` [m]."""
    bodies, poses = _collision_bodies(robot), forward_kinematics(robot.model, q)
    # Shapes first: all that is copied of one lies together.
    centre = np.array([poses.point(joint, local) for joint, local in bodies.centres])
    between = centre[bodies.ends[:, 0]] - centre[bodies.ends[:, 1]]
    return np.asarray(np.sqrt(np.einsum("pni,pni->np", between, between)) - bodies.reach)


def _posture_steps(robot: Robot, q: Array) -> Array:
    """How far each coordinate group of the rates goes from each posture to the next, ``(n - 1, n_rates)``."""
    steps = [pin.difference(robot.model, one, other) for one, other in pairwise(q)]
    step = np.abs(np.reshape(steps, (-1, robot.model.nv)))
    if not robot.floating:
        return step
    base = np.linalg.norm(step[:, :6].reshape(-1, 2, 3), axis=2)
    return np.hstack([base, step[:, 6:]])
