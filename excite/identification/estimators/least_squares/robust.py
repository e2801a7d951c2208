"""Least squares that outlying rows cannot pull far (Huber 1964), by iteratively reweighted rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import finite_or_raised, no_solution
from excite.identification.estimators.scaled import scaled_parameters
from excite.identification.estimators.setting import number
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.noise.correlated import estimate_noise
from excite.identification.orthogonal import row_space
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights

_BLOCK = 4096
_ROUNDS = 100
# Rounds in which the scale still follows the residuals; afterwards the objective is fixed and convex.
_SCALE_ROUNDS = 20
_DISTANCE = 1e-8
# Median absolute deviation of a normal variable, in standard deviations.
_MAD = 0.6744897501960817


@dataclass(frozen=True)
class RobustSettings(EstimatorSettings):
    """Settings of ``robust``.

    Attributes:
        huber: 1.345 keeps 95 % of least squares' efficiency on normal noise (Huber 1964).
    """

    huber: float = number(
        1.345, "1", 0.1, 100.0, "residual, in robust deviations, beyond which rows count less"
    )


class Huber(Estimator[RobustSettings]):
    """Huber's estimate on rows divided by each channel's robust standard deviation.

    Residuals up to ``huber`` deviations count as squares, larger ones linearly, so that an impact or a spike
    weighs as much as a few ordinary rows. Deviations are median absolute residuals over 0.6745, renewed
    with the fit. Reweighted Gram matrices are taken in coordinates in which the rows are orthonormal, where
    squaring costs no accuracy. Of all solutions that fit equally well the one nearest to the nominal model is
    given, as in ``wls``.
    """

    name: ClassVar[str] = "robust"
    title: ClassVar[str] = "least squares on which outliers have bounded influence (Huber)"
    use: ClassVar[str] = (
        "what wls is for, in logs with impacts, spikes or stuck readings that cannot be cut out"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = RobustSettings
    guarantees: ClassVar[str] = (
        "the global minimum of Huber's convex objective at the final robust deviations, its gradient recomputed; "
        "no single row has more influence than one that is `huber` deviations off; bodies need not be able to exist"
    )

    def estimate(self, problem: IdentificationProblem, settings: RobustSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; the spreads are the metric among equal solutions.

        Raises:
            NoSolutionError: the reweighting did not settle; ``best`` is its last state.
        """
        rows = iterate_weights(condense_problem(problem))
        scaled = scaled_parameters(rows, settings)
        space = row_space(scaled.columns(rows.factor[:, :-1]))
        basis = np.zeros((problem.n_params, space.rank))
        basis[scaled.free] = scaled.scales[scaled.free, None] * space.inverse
        missing = rows.factor[:, -1] - rows.factor[:, :-1] @ scaled.center
        parameters = scaled.center + basis @ (space.image.T @ missing)
        distance = np.inf
        for count in range(_ROUNDS):
            residual = problem.residual(parameters)
            if count < _SCALE_ROUNDS:
                rows = rows.weighted(_deviations(problem, residual, rows.std))
            step = _step(rows, basis, residual, settings.huber)
            distance = step.distance
            if distance < _DISTANCE:
                break
            parameters = parameters + step.change
        residual = problem.residual(parameters)
        rows = rows.weighted(rows.std, estimate_noise(problem, rows.grids, residual))
        status = SolveStatus.SOLVED if distance < 1e3 * _DISTANCE else SolveStatus.NOT_OPTIMAL
        weighted = residual / rows.std[problem.channel]
        best = Estimate(
            self.name, parameters, status, rows, float(np.sqrt(np.mean(weighted**2))), float(distance)
        )
        best = finite_or_raised(best)
        if status is not SolveStatus.SOLVED:
            raise no_solution(status, best)
        return best


@dataclass(frozen=True, eq=False)
class _Step:
    """A reweighted step from the present parameters and how far the gradient says they are off.

    Attributes:
        change: ``(n_params,)``.
        distance: length of the step in standard deviations of the noise.
    """

    change: Array
    distance: float


def _deviations(problem: IdentificationProblem, residual: Array, fallback: Array) -> Array:
    """Robust standard deviation of each channel's residual, ``(n_channels,)``."""
    std = fallback.copy()
    for c in range(len(std)):
        of_channel = np.abs(residual[problem.channel == c])
        if len(of_channel):
            std[c] = np.median(of_channel) / _MAD
    # A channel of which more than half is fitted exactly must not take all the weight.
    return np.maximum(std, 1e-6 * max(float(std.max()), 1e-12))


def _step(rows: Regression, basis: Array, residual: Array, bound: float) -> _Step:
    problem, rank = rows.problem, basis.shape[1]
    gram, gradient = np.zeros((rank, rank)), np.zeros(rank)
    scaled = residual / rows.std[problem.channel]
    weight = bound / np.maximum(np.abs(scaled), bound)
    for start in range(0, problem.n_rows, _BLOCK):
        part = slice(start, start + _BLOCK)
        q = (problem.Y[part] / rows.std[problem.channel[part], None]) @ basis
        weighted = q * weight[part, None]
        gram += weighted.T @ q
        gradient += weighted.T @ scaled[part]
    y = np.linalg.solve(gram, gradient)
    return _Step(basis @ y, float(np.sqrt(max(float(y @ gram @ y), 0.0))))
