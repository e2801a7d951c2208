"""The nearest pair of a robot's bodies, without the distances of those that cannot be it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.robot.shapes.collision import bounding_balls


class Spheres:
    """Spheres about bodies: of pairs that they keep further apart than another pair is, no distance is computed."""

    def __init__(self, geometry: pin.GeometryModel, data: pin.GeometryData) -> None:
        self._geometry, self._data = geometry, data
        self._centre, radius = bounding_balls(geometry)
        self._pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs])
        self._reach = radius[self._pairs].sum(axis=1)
        # Views of what pinocchio fills in.
        self._placed = [(placement.rotation, placement.translation) for placement in data.oMg]
        self._rotation, self._position = np.empty((len(self._placed), 3, 3)), np.empty((len(self._placed), 3))
        self._last = 0

    def nearest(self) -> int:
        """The pair of least distance at placements that are up to date; its result is in the data."""
        for i, (rotation, position) in enumerate(self._placed):
            self._rotation[i], self._position[i] = rotation, position
        centre = np.einsum("kij,kj->ki", self._rotation, self._centre) + self._position
        between = centre[self._pairs[:, 0]] - centre[self._pairs[:, 1]]
        least = np.sqrt(np.einsum("pi,pi->p", between, between)) - self._reach
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
