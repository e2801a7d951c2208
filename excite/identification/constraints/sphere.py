"""``vᵀ I v ≥ ε`` on every vector of an icosphere (eq. 13 and 14 of Jovic et al., T-RO 2016), ε absolute.

10 242 vectors and 30 segments make 300 000 rows; they are given in full for checks and as cutting planes,
the rows that an answer violates, for solvers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.constraints.inertia_cone import icosphere_corners, quadratic_rows
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.problem import IdentificationProblem

_CUTS_PER_SEGMENT = 3
# Vectors of one segment's cuts in one round are at least so different (cosine).
_SPREAD = 0.98
_CANDIDATES = 64


@dataclass(frozen=True, eq=False)
class SphereRows:
    """The rows of eq. (14) for all segments whose parameters are free.

    Attributes:
        problem: the problem.
        epsilon: ε [kg·m²].
        subdivisions: subdivisions of the icosahedron; 5 gives 10 242 vectors.
    """

    problem: IdentificationProblem
    epsilon: float
    subdivisions: int

    @cached_property
    def vectors(self) -> Array:
        """The vectors, one of each antipodal pair, which have the same row, ``(n, 3)``."""
        points = icosphere_corners(self.subdivisions)
        z, y, x = points[:, 2], points[:, 1], points[:, 0]
        upper = (z > 0.0) | ((z == 0.0) & ((y > 0.0) | ((y == 0.0) & (x > 0.0))))
        return np.asarray(points[upper])

    @cached_property
    def weights(self) -> Array:
        """Rows on ``Ixx, Ixy, Iyy, Ixz, Iyz, Izz``, ``(n, 6)``."""
        return quadratic_rows(self.vectors)

    def violations(self, parameters: Array) -> Array:
        """Largest violation of each segment over all vectors, ``(n_segments,)`` [kg·m²], 0 where it holds."""
        six = parameters[: self.problem.n_inertial].reshape(-1, 10)[:, 4:]
        worst = np.maximum(self.epsilon - (six @ self.weights.T).min(axis=1), 0.0)
        worst[list(self.problem.unmeasured)] = 0.0
        return np.asarray(worst)

    def cuts(self, parameters: Array, tolerance: float) -> LinearConstraints:
        """The rows that ``parameters`` violate most, some of each segment; none when all hold.

        Args:
            parameters: ``(n_params,)``.
            tolerance: violation that is let pass [kg·m²].
        """
        six = parameters[: self.problem.n_inertial].reshape(-1, 10)[:, 4:]
        values = six @ self.weights.T
        chosen = []
        for index in range(len(values)):
            if index in self.problem.unmeasured or values[index].min() >= self.epsilon - tolerance:
                continue
            order = np.flatnonzero(values[index] < self.epsilon - tolerance)
            order = order[np.argsort(values[index, order], kind="stable")][:_CANDIDATES]
            chosen += [(index, k) for k in self._spread(order, _SPREAD, _CUTS_PER_SEGMENT)]
        return self.rows(chosen)

    def _spread(self, order: NDArray[np.int64], cosine: float, most: int) -> list[int]:
        """The first vectors in an order that are no nearer to each other than a cosine."""
        kept: list[int] = []
        for k in order:
            if len(kept) == most:
                break
            if not kept or np.abs(self.vectors[kept] @ self.vectors[k]).max() < cosine:
                kept.append(int(k))
        return kept

    def lifted(self, parameters: Array, share: float = 1.01) -> Array:
        """A copy in which every free inertia is raised by a multiple of the identity until the rows hold.

        Args:
            parameters: ``(n_params,)``, those of segments that the sensors do not see stay.
            share: of ε that the rows then have.

        Returns:
            ``(n_params,)``.
        """
        raised = parameters.copy()
        ten = raised[: self.problem.n_inertial].reshape(-1, 10)
        values = (ten[:, 4:] @ self.weights.T).min(axis=1)
        lift = np.maximum(share * self.epsilon - values, 0.0)
        lift[list(self.problem.unmeasured)] = 0.0
        ten[:, [4, 6, 9]] += lift[:, None]
        return raised

    def rows(self, chosen: list[tuple[int, int]]) -> LinearConstraints:
        """Rows of (segment, vector) pairs."""
        matrix = np.zeros((len(chosen), self.problem.n_params))
        labels = []
        for place, (segment, vector) in enumerate(chosen):
            matrix[place, 10 * segment + 4 : 10 * segment + 10] = self.weights[vector]
            labels.append(f"sphere:{self.problem.robot.segments[segment].link}")
        return LinearConstraints(matrix, np.full(len(chosen), self.epsilon), tuple(labels))
