"""Parameters as deviations from nominal in units of their spreads, and rows of a fit in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.regression import Regression, prior_std


@dataclass(frozen=True, eq=False)
class Scaled:
    """``θ = center + scales · x`` on the free parameters; the rest stays nominal.

    Attributes:
        center: nominal parameters ``(n_params,)``.
        scales: spreads ``(n_params,)``.
        free: ``(n_free,)`` indices.
    """

    center: Array
    scales: Array
    free: NDArray[np.int64]

    def parameters(self, x: Array) -> Array:
        """``θ`` of ``x``, ``(n_params,)``."""
        theta = self.center.copy()
        theta[self.free] += self.scales[self.free] * x
        return theta

    def coordinates(self, parameters: Array) -> Array:
        """``x`` of ``θ``, ``(n_free,)``."""
        return np.asarray(((parameters - self.center) / self.scales)[self.free])

    def columns(self, matrix: Array) -> Array:
        """Columns that act on ``θ`` made to act on ``x``, ``(…, n_free)``."""
        return matrix[..., self.free] * self.scales[self.free]

    def constraints(self, rows: LinearConstraints) -> LinearConstraints:
        """The same constraints on ``x``, rows of unit length; rows without a free parameter left out."""
        matrix = self.columns(rows.matrix)
        bound = rows.bound - rows.matrix @ self.center
        length = np.linalg.norm(matrix, axis=1)
        kept = length > 0.0
        labels = tuple(label for label, keep in zip(rows.labels, kept, strict=True) if keep)
        n_equal = int(kept[: rows.n_equal].sum())
        return LinearConstraints(
            matrix[kept] / length[kept, None], bound[kept] / length[kept], labels, n_equal
        )


def scaled_parameters(rows: Regression, settings: EstimatorSettings) -> Scaled:
    """Scales from the spreads; parameters of unmeasured segments are not free."""
    problem = rows.problem
    frozen = np.zeros(problem.n_params, dtype=bool)
    for segment in problem.unmeasured:
        frozen[problem.robot.parameter_columns(segment)] = True
    scales = prior_std(problem, settings.spreads(problem.robot))
    return Scaled(problem.prior.copy(), scales, np.flatnonzero(~frozen))
