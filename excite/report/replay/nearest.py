"""The nearest pair of a robot's bodies, without the distances of those that cannot be it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


class Spheres:
    """Spheres about bodies: of pairs that they keep further apart than another pair is, no distance is computed."""

    def __init__(self, geometry: pin.GeometryModel) -> None:
        self._geometry = geometry
        shapes = [one.geometry for one in geometry.geometryObjects]
        for shape in shapes:
            shape.computeLocalAABB()
        self._centre = np.array([shape.aabb_center for shape in shapes])
        radius = np.array([shape.aabb_radius for shape in shapes])
        self._pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs])
        self._reach = radius[self._pairs].sum(axis=1)

    def nearest(self, data: pin.GeometryData) -> int:
        """The pair of least distance at placements that are up to date; its result is in ``data``."""
        centre = np.array([m.act(c) for m, c in zip(data.oMg, self._centre, strict=True)])
        between = centre[self._pairs[:, 0]] - centre[self._pairs[:, 1]]
        least = np.linalg.norm(between, axis=1) - self._reach
        best, nearest = np.inf, 0
        for pair in np.argsort(least).tolist():
            if least[pair] >= best:
                break
            distance = pin.computeDistance(self._geometry, data, pair).min_distance
            if distance < best:
                best, nearest = distance, pair
        return nearest
