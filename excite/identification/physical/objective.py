"""The objective of eq. (15) of Xu et al. 2020: torques that essential parameters leave unexplained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr_delete, solve_triangular

from excite.arrays import Array
from excite.identification.judgement.essential import RSD_ABOVE

# What Xu et al. 2020 call small [SI, units mixed].
VALUE_BELOW = 0.01


@dataclass(frozen=True, eq=False)
class TorqueObjective:
    """``f(θ)² = ‖factor·θ − target‖² + floor²``: eq. (15), condensed by a QR.

    Attributes:
        factor: ``(n_essential, n_params)``.
        target: ``(n_essential,)`` [N·m].
        floor: what no parameters explain [N·m].
        kept: ``(n_essential,)`` indices of the base parameters that are in it.
    """

    factor: Array
    target: Array
    floor: float
    kept: NDArray[np.int64]

    def value(self, parameters: Array) -> float:
        """``f`` [N·m] of standard parameters and drives ``(n_params,)``."""
        rest = self.factor @ parameters - self.target
        return float(np.sqrt(rest @ rest + self.floor**2))


def base_objective(triangle: Array, matrix: Array) -> TorqueObjective:
    """``‖τ − Y_b π_b‖`` with all base parameters.

    Args:
        triangle: ``R`` of ``[Y_b τ] = Q R``, ``(n_base + 1, n_base + 1)``.
        matrix: base parameters as combinations of all parameters, ``(n_base, n_params)``.
    """
    n = len(matrix)
    return TorqueObjective(
        triangle[:n, :n] @ matrix, triangle[:n, n], abs(float(triangle[n, n])), np.arange(n)
    )


def essential_objective(
    triangle: Array,
    matrix: Array,
    n_rows: int,
    *,
    value_below: float = VALUE_BELOW,
    rsd_above: float = RSD_ABOVE,
) -> TorqueObjective:
    """``‖τ − Y_e π_e‖`` with the parameters left by the elimination at the end of section II.A.

    At each round the least-squares parameters are found anew, and of those whose size is below
    ``value_below`` and whose relative standard deviation of eq. (7) is above ``rsd_above`` percent the one of
    greatest standard deviation relative to its size is cancelled.

    Args:
        triangle: ``R`` of ``[Y_b τ] = Q R``, ``(n_base + 1, n_base + 1)``.
        matrix: base parameters as combinations of all parameters, ``(n_base, n_params)``.
        n_rows: number of rows of ``Y_b``.
        value_below: [SI], 0.01 in the paper.
        rsd_above: [%], 40 in the paper.
    """
    n = len(matrix)
    kept, factor, rotated = np.arange(n), triangle[:n, :n], triangle[:n, n]
    squares = float(triangle[n, n]) ** 2
    while len(kept) > 1:
        values = solve_triangular(factor, rotated)
        inverse = solve_triangular(factor, np.eye(len(kept)))
        variance = squares / max(n_rows - len(kept), 1)
        std = np.sqrt(variance * np.einsum("ij,ij->i", inverse, inverse))
        size = np.maximum(np.abs(values), 1e-300)
        cancelled = (size < value_below) & (100.0 * std > rsd_above * size)
        if not cancelled.any():
            break
        worst = int(np.argmax(np.where(cancelled, std / size, -1.0)))
        kept = np.delete(kept, worst)
        rotation, factor = qr_delete(np.eye(len(factor)), factor, worst, which="col")
        rotated = rotation.T @ rotated
        squares += float(rotated[-1]) ** 2
        rotated, factor = rotated[:-1], factor[:-1]
    return TorqueObjective(factor @ matrix[kept], rotated, float(np.sqrt(squares)), kept)
