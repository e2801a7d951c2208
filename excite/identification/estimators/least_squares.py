"""Least squares of rows, plain, weighted, and with the nominal model as a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    checked_estimate,
    estimate_at,
    finite_or_raised,
)
from excite.identification.estimators.scaled_problem import build_ridge
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.regression import Regression, iterate_weights, least_squares, prior_std
from excite.rows.settings import number, word

# Least squares, every row counted alike (eq. 5, Jovic et al. 2016; eq. 6, Xu et al. 2020).


@dataclass(frozen=True)
class LsSettings(EstimatorSettings):
    """Settings of ``ls``.

    Attributes:
        ls_reference: ``zero`` is ``Y⁺f`` (eq. 5 of Jovic et al. 2016), ``nominal`` counts distances in units of
            the spreads.
    """

    ls_reference: str = word("zero", ("zero", "nominal"), "which of equally good solutions is given")


class LeastSquares(Estimator[LsSettings]):
    """Least squares, of all solutions the one of minimum norm ``φ = Y⁺ f`` or the one nearest to nominal.

    Only its base parameters mean anything: which of the solutions is given is a convention.
    """

    name = "ls"
    title = "least squares, minimum norm"
    weighted = False
    use = "comparison with textbooks: channels of one unit and equal noise, base parameters alone"
    settings_class = LsSettings
    guarantees = "no parameters fit the unweighted rows better; bodies need not be able to exist"

    def solve(self, rows: Regression, settings: LsSettings) -> Estimate:
        """See :meth:`Estimator.solve`. Unmeasured segments keep nominal values."""
        problem = rows.problem
        if settings.ls_reference == "nominal":
            scales = prior_std(problem, settings.spreads(problem.robot))
            parameters = least_squares(rows.factor, center=problem.prior, scales=scales)
        else:
            parameters = least_squares(rows.factor)
        parameters = np.where(problem.is_moving, parameters, problem.prior)
        return finite_or_raised(
            replace(estimate_at(self.name, rows, parameters, SolveStatus.SOLVED), distance=0.0)
        )


# The most probable parameters given the data and the nominal model, no other constraint.


class MaximumAPosteriori(Estimator[PullSettings]):
    """The unconstrained minimum of eq. (4) of Jovic et al. 2015, in closed form.

    Predicts better than plain least squares where the motion is short; its bodies need not be able to exist.
    """

    name = "map"
    title = "least squares, pulled to the nominal model where the data say little"
    use = "short motions of which only predictions matter: bodies need not be able to exist"
    settings_class = PullSettings
    guarantees = (
        "the global minimum of the weighted residual plus the weighted distance from the nominal model, in closed "
        "form; bodies need not be able to exist"
    )

    def solve(self, rows: Regression, settings: PullSettings) -> Estimate:
        """See :meth:`Estimator.solve`."""
        objective = build_ridge(rows, settings)
        return finite_or_raised(checked_estimate(self.name, rows, objective, objective.target, 0.0, {}))


# Least squares with each channel weighted by its own residual.


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

    name = "wls"
    title = "least squares, channels weighted by their residuals"
    weighted = False
    use = (
        "base parameters and standard deviations as the data alone give them; where the nominal model is not to be "
        "trusted"
    )
    settings_class = WlsSettings
    guarantees = (
        "no parameters fit the weighted rows better, and none that fit as well are nearer to the nominal model; "
        "bodies need not be able to exist"
    )

    def solve(self, rows: Regression, settings: WlsSettings) -> Estimate:
        """See :meth:`Estimator.solve`; the spreads are the metric among equal solutions."""
        rows, problem = iterate_weights(rows, iterations=settings.weight_iterations), rows.problem
        scales = prior_std(problem, settings.spreads(problem.robot))
        parameters = least_squares(rows.factor, center=problem.prior, scales=scales)
        return finite_or_raised(
            replace(estimate_at(self.name, rows, parameters, SolveStatus.SOLVED), distance=0.0)
        )
