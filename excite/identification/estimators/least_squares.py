"""Least squares of rows, plain, weighted, robust, and with the nominal model as a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import stack_constraints
from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    checked_estimate,
    estimate_at,
    finite_or_raised,
    no_solution,
)
from excite.identification.estimators.scaled_problem import ridge, scaled_parameters
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.noise import estimate_noise
from excite.identification.problem import IdentificationProblem, row_blocks
from excite.identification.regression import (
    Regression,
    iterate_weights,
    least_squares,
    prior_std,
    row_space,
)
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


@dataclass(frozen=True)
class MapSettings(PullSettings):
    """Settings of ``map``: the pull to the nominal model and its spreads."""


class MaximumAPosteriori(Estimator[MapSettings]):
    """The unconstrained minimum of eq. (4) of Jovic et al. 2015, in closed form.

    Predicts better than plain least squares where the motion is short; its bodies need not be able to exist.
    """

    name = "map"
    title = "least squares, pulled to the nominal model where the data say little"
    use = "short motions of which only predictions matter: bodies need not be able to exist"
    settings_class = MapSettings
    guarantees = (
        "the global minimum of the weighted residual plus the weighted distance from the nominal model, in closed "
        "form; bodies need not be able to exist"
    )

    def solve(self, rows: Regression, settings: MapSettings) -> Estimate:
        """See :meth:`Estimator.solve`."""
        objective = ridge(rows, settings)
        nothing = stack_constraints([], len(objective.target))
        return finite_or_raised(checked_estimate(self.name, rows, objective, objective.target, 0.0, nothing))


# Least squares that outlying rows cannot pull far (Huber 1964), by iteratively reweighted rows.

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

    name = "robust"
    title = "least squares on which outliers have bounded influence (Huber)"
    use = "what wls is for, in logs with impacts, spikes or stuck readings that cannot be cut out"
    settings_class = RobustSettings
    guarantees = (
        "the global minimum of Huber's convex objective at the final robust deviations, its gradient recomputed; "
        "no single row has more influence than one that is `huber` deviations off; bodies need not be able to exist"
    )

    def solve(self, rows: Regression, settings: RobustSettings) -> Estimate:
        """See :meth:`Estimator.solve`; the spreads are the metric among equal solutions.

        Raises:
            NoSolutionError: the reweighting did not settle; ``best`` is its last state.
        """
        problem = rows.problem
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
        best = replace(estimate_at(self.name, rows, parameters, status), distance=float(distance))
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
    for part in row_blocks(problem.n_rows):
        q = (problem.Y[part] / rows.std[problem.channel[part], None]) @ basis
        weighted = q * weight[part, None]
        gram += weighted.T @ q
        gradient += weighted.T @ scaled[part]
    y = np.linalg.solve(gram, gradient)
    return _Step(basis @ y, float(np.sqrt(max(float(y @ gram @ y), 0.0))))


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
