"""Curves through knots with given derivatives, polynomial in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.motion.generators.curves import Curve


@dataclass(frozen=True, eq=False)
class PolynomialCurve(Curve):
    """A piecewise polynomial, constant beyond its ends.

    Attributes:
        breaks: path parameters at which the polynomials join, ``(m + 1,)``, from 0.
        coefficients: by falling power of the distance from a piece's start, ``(degree + 1, m, dimension)``.
    """

    breaks: Array
    coefficients: Array

    @property
    def length(self) -> float:
        """Of all pieces."""
        return float(self.breaks[-1])

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return int(self.coefficients.shape[2])

    def evaluate(self, s: Array, order: int = 0) -> Array:
        """Values or derivatives at ``s``, ``(n, dimension)``."""
        from scipy.interpolate import PPoly

        inside = np.clip(np.asarray(s, dtype=float), 0.0, self.breaks[-1])
        return np.asarray(PPoly(self.coefficients, self.breaks)(inside, nu=order))

    def shrunk(self, factor: float | Array) -> PolynomialCurve:
        """Excursions from the value at the start scaled by a factor, or by one a coordinate, ``(dimension,)``."""
        scaled = factor * self.coefficients
        scaled[-1] += (1.0 - factor) * self.evaluate(np.zeros(1))[0]
        return PolynomialCurve(self.breaks, scaled)


def hermite_curve(
    s: Array, values: Array, first: Array | None = None, second: Array | None = None
) -> PolynomialCurve:
    """The quintic Hermite polynomials through knots: value and two derivatives are those given at each.

    Args:
        s: knots, ``(m,)``, increasing from 0.
        values: ``(m, dimension)``.
        first: first derivatives at the knots, ``(m, dimension)``; zero if left out.
        second: second derivatives, likewise.
    """
    from scipy.interpolate import BPoly, PPoly

    nothing = np.zeros_like(values)
    data = np.stack(
        [values, nothing if first is None else first, nothing if second is None else second], axis=1
    )
    polynomial = PPoly.from_bernstein_basis(BPoly.from_derivatives(s, data))
    return PolynomialCurve(np.asarray(polynomial.x), np.asarray(polynomial.c))


def polyline_curve(s: Array, values: Array) -> PolynomialCurve:
    """Straight lines through knots ``(m,)``, increasing from 0, with values ``(m, dimension)``."""
    slope = np.diff(values, axis=0) / np.diff(s)[:, None]
    return PolynomialCurve(s, np.stack([slope, values[:-1]]))
