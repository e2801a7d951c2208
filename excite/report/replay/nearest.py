"""The nearest pair of a robot's bodies, without the distances of those that cannot be it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot
from excite.robot.shapes.collision import bounding_balls


class Spheres:
    """Spheres about bodies: of pairs that they keep further apart than another pair is, no distance is computed."""

    def __init__(self, robot: Robot, geometry: pin.GeometryModel, data: pin.GeometryData, q: Array) -> None:
        """Of a robot in configurations ``(n, nq)``; distances are computed in ``data``."""
        self._geometry, self._data = geometry, data
        local, radius = bounding_balls(geometry)
        placed, objects = forward_kinematics(robot.model, q), list(geometry.geometryObjects)
        centre = np.empty((len(q), len(objects), 3))
        for i, (one, point) in enumerate(zip(objects, local, strict=True)):
            centre[:, i] = placed.point(one.parentJoint, one.placement.act(point))
        first, second = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs]).T
        between = centre[:, first] - centre[:, second]
        self._least = np.sqrt(np.einsum("npi,npi->np", between, between)) - (radius[first] + radius[second])
        self._last = 0

    def nearest(self, k: int) -> int:
        """The pair of least distance in a configuration that the data is placed in; its result is in the data."""
        least = self._least[k]
        # The pair that was nearest before is near still, and few can be nearer.
        nearest = self._last
        best = pin.computeDistance(self._geometry, self._data, nearest).min_distance
        open_ = np.flatnonzero(least < best)
        for pair in open_[np.argsort(least[open_])].tolist():
            if least[pair] >= best:
                break
            distance = pin.computeDistance(self._geometry, self._data, pair).min_distance
            if distance < best:
                best, nearest = distance, pair
        self._last = nearest
        return nearest
