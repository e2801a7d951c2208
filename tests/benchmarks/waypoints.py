"""Motions from waypoint to waypoint, at rest in each, as FIGAROH optimises them: a family of somebody else's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from excite.arrays import Array
from excite.excitation.series import MotionFamily
from excite.motion.generators.curves import Curve

# Quintic Hermite blend from 0 to 1 with vanishing first and second derivatives at both ends, by power of u.
_BLEND = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])


@dataclass(frozen=True, eq=False)
class WaypointCurve(Curve):
    """Straight segments in joint space, each run by a quintic blend from rest to rest.

    Attributes:
        points: waypoints, ``(m, dimension)``, ``m ≥ 2``.
        segment: length of the path parameter's interval between two of them.
    """

    points: Array
    segment: float = 1.0

    @property
    def length(self) -> float:
        """Of all segments."""
        return (len(self.points) - 1) * self.segment

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return int(self.points.shape[1])

    def evaluate(self, s: Array, order: int = 0) -> Array:
        """Values or derivatives at ``s``, ``(n, dimension)``."""
        scaled = np.asarray(s, dtype=float) / self.segment
        k = np.clip(np.floor(scaled).astype(int), 0, len(self.points) - 2)
        u = scaled - k
        blend = np.polynomial.Polynomial(_BLEND).deriv(order) if order else np.polynomial.Polynomial(_BLEND)
        weight = blend(u)[:, None] / self.segment**order
        step = weight * (self.points[k + 1] - self.points[k])
        return np.asarray(self.points[k] + step if order == 0 else step)

    def shrunk(self, factor: float) -> WaypointCurve:
        """Waypoints moved towards the first by ``factor``."""
        return replace(self, points=self.points[0] + factor * (self.points - self.points[0]))


def waypoint_family(segment: float, n_segments: int) -> MotionFamily:
    """From waypoint to waypoint, at rest in each: quintic Hermite segments of equal duration, half a period each.

    Coefficients are the waypoints after the first, relative to it.
    """
    return MotionFamily(n_segments * segment, 0.5 / segment, n_segments, partial(_through, segment))


def _through(segment: float, offset: Array, coefficients: Array) -> WaypointCurve:
    offset = np.asarray(offset, dtype=float)
    return WaypointCurve(np.vstack([offset, offset + coefficients.T]), segment)
