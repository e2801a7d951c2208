"""The problem of the entropic divergence and what a solver says about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.cones import triangle_of
from excite.identification.constraints.linear import LinearConstraints


@dataclass(frozen=True, eq=False)
class EntropicProblem:
    """``min ½‖z − target‖² + Σ wᵢ (−log|Xᵢ| + tr Xᵢ − ½ tr(Xᵢ − 1)²)`` with linear constraints.

    Attributes:
        target: ``(n,)``.
        maps: ``z`` to the ten entries of ``X − 1``, ``(n_segments, 10, n)``.
        weights: ``w``, ``(n_segments,)``.
        linear: rows on ``z``, of unit length.
    """

    target: Array
    maps: Array
    weights: Array
    linear: LinearConstraints

    def relative(self, z: Array) -> Array:
        """``X`` of each segment, ``(n_segments, 4, 4)``."""
        return np.eye(4) + triangle_of(4).matrices(self.maps @ z)

    def violations(self, z: Array) -> dict[str, float]:
        """Largest violation of each kind of constraint."""
        worst = {"pseudo_inertia": abs(float(np.linalg.eigvalsh(self.relative(z))[:, 0].min(initial=0.0)))}
        for label, value in zip(self.linear.labels, self.linear.violations(z), strict=True):
            kind = label.split(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), float(value))
        return worst

    def gradient(self, z: Array) -> Array:
        """``(n,)``; ``X`` must be positive definite."""
        x = self.relative(z)
        slope = triangle_of(4).vectors(2.0 * np.eye(4) - np.linalg.inv(x) - x) * self.weights[:, None]
        return z - self.target + np.tensordot(slope, self.maps, 2)

    def hessian(self, z: Array) -> Array:
        """``(n, n)``."""
        shape = triangle_of(4)
        inverse = np.linalg.inv(self.relative(z))
        unit = shape.matrices(np.eye(10))
        curved = shape.vectors(
            np.einsum("bij,ejk,bkl->beil", inverse, unit, inverse, optimize=True)
        ) - np.eye(10)
        blocks = (curved * self.weights[:, None, None]) @ self.maps
        n = len(z)
        return np.eye(n) + self.maps.reshape(-1, n).T @ blocks.reshape(-1, n)


@dataclass(frozen=True, eq=False)
class EntropicAnswer:
    """What a solver says.

    Attributes:
        z: the point, ``(n,)``.
        multipliers: one a row of the linear constraints, ``(n_rows,)``.
    """

    z: Array
    multipliers: Array


EntropicSolver = Callable[[EntropicProblem], "EntropicAnswer | None"]
