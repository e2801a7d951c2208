"""Least squares with each channel weighted by its own residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import finite_or_raised
from excite.identification.estimators.setting import number
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights, least_squares, prior_std


@dataclass(frozen=True)
class WlsSettings(EstimatorSettings):
    """Settings of ``wls``.

    Attributes:
        weight_iterations: rounds in which the weights follow the residuals; 0 keeps the weights that the log states.
    """

    weight_iterations: int = number(10, "1", 0, 100, "rounds of reweighting; 0 keeps stated weights")


class WeightedLeastSquares(Estimator[WlsSettings]):
    """Weighted least squares (Gautier 1997): channel weights from residual variances, iterated.

    Of all solutions that fit equally well the one nearest to the nominal model is given, distances counted
    in units of :func:`~excite.identification.regression.prior_std`.
    """

    name: ClassVar[str] = "wls"
    title: ClassVar[str] = "least squares, channels weighted by their residuals"
    use: ClassVar[str] = (
        "base parameters and standard deviations as the data alone give them; where the nominal model is not to be "
        "trusted"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = WlsSettings
    guarantees: ClassVar[str] = (
        "no parameters fit the weighted rows better, and none that fit as well are nearer to the nominal model; "
        "bodies need not be able to exist"
    )

    def estimate(self, problem: IdentificationProblem, settings: WlsSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; the spreads are the metric among equal solutions."""
        rows = iterate_weights(condense_problem(problem), iterations=settings.weight_iterations)
        scales = prior_std(problem, settings.spreads(problem.robot))
        parameters = least_squares(rows.factor, center=problem.prior, scales=scales)
        weighted = problem.residual(parameters) / rows.std[problem.channel]
        residual = float(np.sqrt(np.mean(weighted**2)))
        return finite_or_raised(Estimate(self.name, parameters, SolveStatus.SOLVED, rows, residual))
