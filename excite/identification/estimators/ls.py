"""Least squares, every row counted alike (eq. 5, Jovic et al. 2016; eq. 6, Xu et al. 2020)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import least_squares, regression


class LeastSquares(Estimator):
    """Minimum-norm least squares ``φ = Y⁺ f``; only its base parameters mean anything."""

    name: ClassVar[str] = "ls"
    title: ClassVar[str] = "least squares, minimum norm"

    def estimate(self, problem: IdentificationProblem, settings: EstimatorSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; uses no settings. Unmeasured segments keep nominal values."""
        rows = regression(problem)
        parameters = least_squares(rows.factor)
        for segment in problem.unmeasured:
            columns = problem.robot.parameter_columns(segment)
            parameters[columns] = problem.prior[columns]
        residual = float(np.sqrt(np.mean(problem.residual(parameters) ** 2)))
        return Estimate(self.name, parameters, SolveStatus.SOLVED, rows, residual)
