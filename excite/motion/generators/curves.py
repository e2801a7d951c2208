"""Smooth curves over a path parameter: uniform cubic B-splines and finite Fourier series."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array

# Basis of the uniform cubic B-spline: row k holds the coefficients of u⁰…u³ for the k-th of four control points.
_BASIS = (
    np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]])
    / 6.0
)


class Curve(ABC):
    """A curve ``s ↦ (dimension,)`` on ``[0, length]``, whose first two derivatives vanish at both ends."""

    @property
    @abstractmethod
    def length(self) -> float:
        """End of the path parameter's interval."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Number of coordinates."""

    @abstractmethod
    def evaluate(self, s: Array, order: int = 0) -> Array:
        """Values, or derivatives with respect to ``s``, at path parameters ``(n,)``: ``(n, dimension)``."""

    @abstractmethod
    def shrunk(self, factor: float) -> Curve:
        """The same curve with its excursions about its start scaled by ``factor``."""


@dataclass(frozen=True, eq=False)
class SplineCurve(Curve):
    """A uniform cubic B-spline.

    It stays inside the convex hull of its control points, so that a box around them is a box around the
    curve, and control point ``i`` acts on the spans ``i-3 … i`` alone. The first three control points are
    equal, and so are the last three: the curve starts and ends there with zero velocity and acceleration.

    Attributes:
        control: control points, ``(m, dimension)``; one span of unit length each from ``m ≥ 6`` on: ``m - 3``.
    """

    control: Array

    @property
    def length(self) -> float:
        """Number of spans."""
        return float(len(self.control) - 3)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return int(self.control.shape[1])

    def evaluate(self, s: Array, order: int = 0) -> Array:
        """Values or derivatives at ``s``, ``(n, dimension)``."""
        s = np.asarray(s, dtype=float)
        span = np.clip(np.floor(s).astype(int), 0, len(self.control) - 4)
        u = s - span
        powers = np.zeros((len(s), 4))
        for k in range(order, 4):
            factor = np.prod(np.arange(k, k - order, -1.0))
            powers[:, k] = factor * u ** (k - order)
        weights = powers @ _BASIS.T
        return np.asarray(np.einsum("nk,nkd->nd", weights, self.control[span[:, None] + np.arange(4)]))

    def shrunk(self, factor: float | Array) -> SplineCurve:
        """Control points moved towards the first by a factor, or by one a coordinate, ``(dimension,)``."""
        return replace(self, control=self.control[0] + factor * (self.control - self.control[0]))


@dataclass(frozen=True, eq=False)
class FourierCurve(Curve):
    """A finite Fourier series in the form of Ni et al. 2024, eq. (8), about an offset.

    ``q_i(s) = offset_i + Σ_l a_il/(ω l) sin(ω l s) − b_il/(ω l) cos(ω l s)``, over whole periods.

    Attributes:
        offset: ``(dimension,)``, the position at the start.
        a: sine coefficients, ``(dimension, L)`` [unit of the offset per second].
        b: cosine coefficients, ``(dimension, L)``.
        omega: fundamental angular frequency [rad/s].
        periods: number of periods.
    """

    offset: Array
    a: Array
    b: Array
    omega: float
    periods: int = 1

    @property
    def length(self) -> float:
        """Duration of all periods [s]; the path parameter is time."""
        return self.periods * 2.0 * np.pi / self.omega

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.offset)

    def evaluate(self, s: Array, order: int = 0) -> Array:
        """Values or derivatives at times ``s``, ``(n, dimension)``."""
        harmonics = self.omega * np.arange(1, self.a.shape[1] + 1)
        phase = np.asarray(s, dtype=float)[:, None] * harmonics
        # Each derivative multiplies by ωl and advances both functions by a quarter period.
        shift = 0.5 * np.pi * order
        scale = harmonics ** (order - 1)
        values = np.sin(phase + shift) @ (self.a * scale).T - np.cos(phase + shift) @ (self.b * scale).T
        return values + self.offset if order == 0 else values

    def shrunk(self, factor: float) -> FourierCurve:
        """Coefficients scaled by ``factor``."""
        return replace(self, a=factor * self.a, b=factor * self.b)
