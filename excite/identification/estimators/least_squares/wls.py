"""Least squares with each channel weighted by its own residual."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import finite_or_raised
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import iterate_weights, least_squares, prior_std, regression


class WeightedLeastSquares(Estimator):
    """Weighted least squares (Gautier 1997): channel weights from residual variances, iterated.

    Of all solutions that fit equally well the one nearest to the nominal model is given, distances counted
    in units of :func:`~excite.identification.regression.prior_std`.
    """

    name: ClassVar[str] = "wls"
    title: ClassVar[str] = "least squares, channels weighted by their residuals"
    guarantees: ClassVar[str] = (
        "no parameters fit the weighted rows better, and none that fit as well are nearer to the nominal model; "
        "bodies need not be able to exist"
    )

    def estimate(self, problem: IdentificationProblem, settings: EstimatorSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; uses ``weight_iterations``, and the spreads as the metric among equal
        solutions."""
        rows = iterate_weights(regression(problem), iterations=settings.weight_iterations)
        scales = prior_std(problem, settings.spreads(problem.robot))
        parameters = least_squares(rows.factor, center=problem.prior, scales=scales)
        weighted = problem.residual(parameters) / rows.std[problem.channel]
        residual = float(np.sqrt(np.mean(weighted**2)))
        return finite_or_raised(Estimate(self.name, parameters, SolveStatus.SOLVED, rows, residual))
