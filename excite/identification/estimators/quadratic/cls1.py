"""Parameters within bounds nearest to the unconstrained base solution (CLS-1 of Golluccio et al. 2020)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.bounds import default_bounds, within_bounds
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.constraints.stated_bounds import speaks_of, stated_bounds
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import no_solution
from excite.identification.estimators.quadratic.active_set import ActiveSetProjector
from excite.identification.estimators.quadratic.hierarchy import solve_hierarchy
from excite.identification.estimators.quadratic.hierarchy_state import Level
from excite.identification.estimators.quadratic.projection import Projector
from excite.identification.estimators.scaled import scaled_parameters
from excite.identification.estimators.settings import EstimatorSettings, ParameterBoundsSettings
from excite.identification.physical.default_bounds import default_bounds as physical_bounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import (
    RANK_TOLERANCE,
    Regression,
    condense_problem,
    iterate_weights,
    least_squares,
    prior_std,
)
from excite.regressor.base_parameters import base_parameters

_VIOLATION = 1e-6


@dataclass(frozen=True)
class Cls1Settings(ParameterBoundsSettings):
    """Settings of ``cls1``: bounds of the parameters, stated ones before those about the nominal model."""


class BoundedNearBase(Estimator[Cls1Settings]):
    """``bounds ≻ (π_b(π) = π̂_b) ≻ (π = π_nominal)``: CLS-1 with what it leaves open decided.

    ``π̂_b`` are the least-squares base parameters. The distance from them is the plain sum of squares of SI
    values, as in the paper: it counts a kilogram like a kg·m² and does not know how well each is determined,
    which is why the method predicts less well than others that use the same data. Among equals, the
    parameters nearest to nominal are given, in units of the spreads.
    """

    name: ClassVar[str] = "cls1"
    title: ClassVar[str] = "bounded parameters nearest to the unconstrained base solution (CLS-1)"
    use: ClassVar[str] = (
        "comparison with published CLS-1 results: parameters within bounds; bodies need not be able to exist"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = Cls1Settings
    guarantees: ClassVar[str] = (
        "every parameter within its bounds, and no others within them have base parameters nearer to the "
        "least-squares ones; bodies need not be able to exist"
    )
    exempt: ClassVar[Mapping[str, str]] = {
        "prediction": "nearest in parameters, not in what they predict (CLS-1 of Golluccio et al. 2020)"
    }

    def __init__(self, projector: Projector | None = None):
        self._projector = projector

    def estimate(self, problem: IdentificationProblem, settings: Cls1Settings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: Cls1Settings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            InputError: bounds that leave nothing.
            NoSolutionError: an answer fails its recomputation.
        """
        problem = rows.problem
        scaled = scaled_parameters(rows, settings)
        bounds = parameter_bounds(rows, settings)
        level = Level("bounds", scaled.constraints(bound_rows(rows, settings)))
        n = problem.n_params
        base = base_parameters(rows.factor[:, :n], problem.parameter_names, RANK_TOLERANCE).matrix
        wanted = base @ (
            least_squares(rows.factor, center=scaled.center, scales=scaled.scales) - scaled.center
        )
        start = np.clip(scaled.center, *bounds)
        answer = solve_hierarchy(
            (level,),
            scaled.columns(base),
            wanted,
            self._projector or ActiveSetProjector(),
            ((start - scaled.center) / scaled.scales)[scaled.free],
        )
        violation = level.constraints.violations(answer.x)
        slack = level.constraints.matrix @ answer.x - level.constraints.bound
        status = answer.status
        if status is SolveStatus.SOLVED and violation.max(initial=0.0) > _VIOLATION:
            status = SolveStatus.VIOLATED
        parameters = scaled.parameters(answer.x)
        # What rounding leaves outside a bound is put onto it.
        if status is SolveStatus.SOLVED:
            parameters[scaled.free] = np.clip(parameters, *bounds)[scaled.free]
        weighted = problem.residual(parameters) / rows.std[problem.channel]
        active = [
            label for label, left in zip(level.constraints.labels, slack, strict=True) if left < _VIOLATION
        ]
        best = Estimate(
            method=self.name,
            parameters=parameters,
            status=status,
            regression=rows,
            residual=float(np.sqrt(np.mean(weighted**2))),
            distance=answer.fit_distance,
            violations={"bounds": float(violation.max(initial=0.0))},
            active=tuple(active),
        )
        if status is not SolveStatus.SOLVED:
            raise no_solution(status, best)
        return best


def parameter_bounds(rows: Regression, settings: ParameterBoundsSettings) -> Array:
    """Bounds from the settings, ``(2, n_params)``, else some spreads about nominal.

    Those spreads give way where the settings state bounds of the parameter.
    """
    if settings.parameter_bounds is not None:
        return np.asarray(settings.parameter_bounds, dtype=float)
    problem = rows.problem
    spread = prior_std(problem, settings.spreads(problem.robot))
    bounds = default_bounds(problem, spread, settings.bound_width)
    if settings.bounds is not None:
        bounds[:, speaks_of(problem, settings.bounds)] = [[-np.inf], [np.inf]]
    return bounds


def bound_rows(
    rows: Regression, settings: ParameterBoundsSettings, places: tuple[int, ...] | None = None
) -> LinearConstraints:
    """Rows of the bounds of parameters and of those that the settings state.

    Args:
        rows: the rows.
        settings: the settings.
        places: which of a segment's ten parameters get bounds that are not stated, all and the drives if None.
    """
    problem = rows.problem
    bounds = within_bounds(problem, parameter_bounds(rows, settings), places)
    if settings.bounds is None:
        return bounds
    usual = physical_bounds(problem.robot, settings)
    return stack_constraints([bounds, stated_bounds(problem, settings.bounds, usual)], problem.n_params)
