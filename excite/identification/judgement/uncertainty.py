"""How well each standard parameter is known from the data and the nominal model together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, svd

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.identification.statistics import BaseStatistics


@dataclass(frozen=True, eq=False)
class ParameterUncertainty:
    """How well the standard parameters are known.

    Attributes:
        std: of each parameter, given the data and the spread that the nominal model is granted [SI].
        determined: share of that spread's variance that the data have taken away, 0 to 1: near 0 the value is
            the nominal model's and the constraints' choice, near 1 it was measured.
        covariance: ``(n_params, n_params)`` whose diagonal is ``std`` squared; None where only that is known.
    """

    std: Array
    determined: Array
    covariance: Array | None = None


def parameter_uncertainty(
    problem: IdentificationProblem, statistics: BaseStatistics, spread: Array
) -> ParameterUncertainty:
    """Posterior of the standard parameters of a Gaussian prior about the nominal model.

    With ``P`` the prior's covariance, ``K`` the base parameters as combinations of the standard ones and
    ``R⁻¹ M R⁻ᵀ`` their covariance, ``P − P Kᵀ (K P Kᵀ + R⁻¹ M R⁻ᵀ)⁻¹ K P``. It is computed as
    ``P − P Kᵀ Rᵀ (R K P Kᵀ Rᵀ + M)⁻¹ R K P``: the inverse of ``R`` has no digits left of directions that the motions
    hardly show. Directions outside ``K`` no motion shows: there the prior stays. Inequalities (positive masses,
    physical consistency) are not used and could only narrow it.

    Args:
        problem: the rows.
        statistics: base parameters and their covariance.
        spread: spread of each segment's mass about nominal as share of it, ``(n_segments,)``, as
            :func:`~excite.identification.regression.prior_std` takes it.

    Returns:
        Standard deviations, shares and covariance.
    """
    prior = prior_std(problem, spread)
    power, axes = eigh(statistics.meat)
    # What noise has rounded away is as small as the rounding of the largest.
    power = np.maximum(power, max(np.finfo(float).eps * power[-1], np.finfo(float).tiny))
    shown = axes.T @ (statistics.factor @ (statistics.base.matrix * prior)) / np.sqrt(power)[:, None]
    _, sizes, directions = svd(shown, full_matrices=False)
    share = sizes**2 / (1.0 + sizes**2)
    determined = np.clip(share @ directions**2, 0.0, 1.0)
    left = np.eye(len(prior)) - (directions.T * share) @ directions
    covariance = left * np.outer(prior, prior)
    return ParameterUncertainty(prior * np.sqrt(1.0 - determined), determined, covariance)
