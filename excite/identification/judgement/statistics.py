"""Base parameters with intervals that hold for filtered noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import stdtrit

from excite.arrays import Array
from excite.identification.noise.bands import noise_bands
from excite.identification.noise.correlated import NoiseModel, upper_triangle
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import RANK_TOLERANCE, Regression, leaves_freedom
from excite.regressor.base_parameters import BaseParameters, base_parameters
from excite.regressor.columns import PARAMETERS
from excite.threads import one_blas_thread

_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class BaseStatistics:
    """Least-squares base parameters and their covariance.

    With ``X = QR`` the weighted base columns and ``Σ`` the covariance of the weighted noise,
    ``cov = R⁻¹ (QᵀΣQ) R⁻ᵀ``: the sandwich that is right whatever the rows' weights and correlations are. For
    white noise it is eq. (7) of Xu et al. 2020.

    Attributes:
        base: which combinations the rows determine.
        estimate: ``(n_base,)`` least-squares values [SI].
        factor: ``R``, ``(n_base, n_base)``.
        meat: ``QᵀΣQ``, ``(n_base, n_base)``, free of what the fit has taken from the residuals.
        rotated: ``Qᵀy``, ``(n_base,)``.
        noise: noise model, free of it likewise.
        white_std: ``(n_base,)`` what eq. (7) says, as if all rows were independent.
        degrees_of_freedom: ``(n_base,)`` on which each standard deviation rests.
    """

    base: BaseParameters
    estimate: Array
    factor: Array
    meat: Array
    rotated: Array
    noise: NoiseModel
    white_std: Array
    degrees_of_freedom: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance of ``estimate``, ``(n_base, n_base)``."""
        return _sandwich(self.factor, self.meat)

    @property
    def std(self) -> Array:
        """Standard deviations of ``estimate``, ``(n_base,)``."""
        return np.sqrt(np.diag(self.covariance))

    def half_width(self, level: float = 0.95) -> Array:
        """Half the width of the interval that holds the truth with probability ``level``, ``(n_base,)``.

        Student's quantile, as the noise's power is estimated from the same residuals.
        """
        return np.asarray(stdtrit(self.degrees_of_freedom, 0.5 * (1.0 + level)) * self.std)

    def rsd_percent(self, values: Array) -> Array:
        """Relative standard deviation ``100 σ/|value|``, ``(n_base,)`` [percent], infinite at zero."""
        return relative_percent(self.std, values)


@one_blas_thread
def base_statistics(rows: Regression, base: BaseParameters | None = None) -> BaseStatistics:
    """Least squares on the base parameters of weighted rows, with the covariance of correlated noise.

    Args:
        rows: the rows, weighted as the estimate to be judged was.
        base: base parameters to use, all of which the rows must determine; None takes the rows' own.

    Raises:
        InputError: the rows are zero or not finite.
    """
    problem = rows.problem
    n = problem.n_params
    if base is None:
        base = base_parameters(rows.factor[:, :n], parameter_labels(problem), RANK_TOLERANCE)
    columns = base.independent
    r = upper_triangle(rows.factor[:, [*columns, n]])
    factor, rotated = r[: base.rank, : base.rank], r[: base.rank, base.rank]
    estimate = solve_triangular(factor, rotated)
    weight = 1.0 / rows.std[problem.channel]
    q = _orthonormal(problem.Y, columns, weight, factor)
    residual = problem.y * weight - q @ (factor @ estimate)
    if rows.noise is not None and not leaves_freedom(rows):
        # The residual is none of the noise's; what the weights say of it stays.
        meat = float(rows.noise.inflation.max()) * np.eye(base.rank)
        ones = np.ones(base.rank)
        white = np.sqrt(np.diag(_sandwich(factor, np.eye(base.rank))))
        return BaseStatistics(base, estimate, factor, meat, rotated, rows.noise, white, ones)
    bands = noise_bands(problem, rows.grids, q, residual, factor)
    variance = float(residual @ residual) / max(problem.n_rows - base.rank, 1)
    return BaseStatistics(
        base=base,
        estimate=estimate,
        factor=factor,
        meat=bands.meat,
        rotated=rotated,
        noise=bands.model(problem, rows.grids, rows.std),
        white_std=np.sqrt(variance * np.diag(_sandwich(factor, np.eye(base.rank)))),
        degrees_of_freedom=bands.degrees_of_freedom,
    )


def parameter_labels(problem: IdentificationProblem) -> tuple[str, ...]:
    """Readable names of the columns, ``Izz(torso)``, ``viscous(joint1)``: those of the regressor room."""
    labels = [f"{name}({segment.name})" for segment in problem.robot.segments for name in PARAMETERS]
    drives = (name.partition(".") for name in problem.parameter_names[problem.n_inertial :])
    return (*labels, *(f"{term}({joint})" for term, _, joint in drives))


def _orthonormal(matrix: Array, columns: NDArray[np.int64], weight: Array, factor: Array) -> Array:
    """``W X R⁻¹``, ``(n_rows, n_base)``, block by block so that there is only one copy."""
    q = np.empty((len(matrix), len(columns)))
    for start in range(0, len(matrix), _BLOCK):
        rows = slice(start, start + _BLOCK)
        weighted = matrix[rows, columns] * weight[rows, None]
        q[rows] = solve_triangular(factor, weighted.T, trans="T", check_finite=False).T
    return q


def _sandwich(factor: Array, meat: Array) -> Array:
    inverse = solve_triangular(factor, np.eye(len(factor)))
    return np.asarray(inverse @ meat @ inverse.T)


def relative_percent(std: Array, values: Array) -> Array:
    """``100 σ/|value|`` [percent] of ``(n,)`` values, infinite where the value is zero."""
    size = np.abs(values)
    return np.where(size > 0.0, 100.0 * std / np.where(size > 0.0, size, 1.0), np.inf)
