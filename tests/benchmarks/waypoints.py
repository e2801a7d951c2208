"""Motions from waypoint to waypoint, at rest in each, as FIGAROH optimises them: a family of somebody else's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.excitation.optimisation.motions import MotionFamily
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


class WaypointFamily(MotionFamily):
    """From waypoint to waypoint, at rest in each: quintic Hermite segments of equal duration."""

    def __init__(self, segment: float, n_segments: int) -> None:
        self._segment, self._n = segment, n_segments

    @property
    def n_coefficients(self) -> int:
        """Waypoints after the first, relative to it."""
        return self._n

    @property
    def length(self) -> float:
        """Of all segments [s]."""
        return self._n * self._segment

    @property
    def fastest_hz(self) -> float:
        """A segment is half a period there and back."""
        return 0.5 / self._segment

    def basis(self, time: Array, order: int) -> Array:
        """Values or derivatives, by evaluating the curves of the unit vectors."""
        return self.curve(np.zeros(self._n), np.eye(self._n)).evaluate(time, order)

    def curve(self, offset: Array, coefficients: Array) -> WaypointCurve:
        """The motion through the waypoints."""
        offset = np.asarray(offset, dtype=float)
        points = np.vstack([offset, offset + coefficients.T])
        return WaypointCurve(points, self._segment)
