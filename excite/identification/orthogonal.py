"""A matrix split into what it determines and what it does not, without iterations that could fail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

from excite.arrays import Array
from excite.identification.regression import RANK_TOLERANCE


@dataclass(frozen=True, eq=False)
class RowSpace:
    """``A = Q · y-map``: for ``x = inverse · y + null · n`` the product ``A x`` is ``image · y``.

    ``image`` has orthonormal columns, so ``‖A x − b‖² = ‖y − imageᵀ b‖² + const``; ``null`` is an orthonormal
    basis of what ``A`` does not see, orthogonal to ``inverse``.

    Attributes:
        image: ``(m, rank)``.
        inverse: ``(n, rank)``.
        null: ``(n, n - rank)``.
    """

    image: Array
    inverse: Array
    null: Array

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return int(self.image.shape[1])


def row_space(matrix: Array, tolerance: float = RANK_TOLERANCE) -> RowSpace:
    """Complete orthogonal factorisation ``A P = Q [R; 0]``, ``Rᵀ = V [T; 0]`` (Golub and Van Loan, 5.4.7).

    Args:
        matrix: ``(m, n)``, columns of comparable units.
        tolerance: pivots below this share of the first are zero.
    """
    m, n = matrix.shape
    if not matrix.size:
        return RowSpace(np.zeros((m, 0)), np.zeros((n, 0)), np.eye(n))
    q, r, pivots = qr(matrix, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    rank = int(np.count_nonzero(diagonal > tolerance * max(float(diagonal[0]), 1e-300)))
    top = np.empty((n, rank))
    top[pivots] = r[:rank].T
    v, t = qr(top, mode="full", check_finite=False) if rank else (np.eye(n), np.zeros((n, 0)))
    inverse = v[:, :rank] @ solve_triangular(t[:rank], np.eye(rank), trans="T") if rank else np.zeros((n, 0))
    return RowSpace(q[:, :rank], inverse, v[:, rank:])
