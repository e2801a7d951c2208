"""Estimators by quadratic programs: their solvers, and the hierarchies of levels that they solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.identification.constraints.cones import InertiaCone, inertia_cone
from excite.identification.constraints.linear import (
    LinearConstraints,
    default_bounds,
    model_constraints,
    speaks_of,
    stack_constraints,
    stated_bounds,
    within_bounds,
)
from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    best_known,
    checked_estimate,
    no_solution,
)
from excite.identification.estimators.hierarchy import Level, solve_hierarchy
from excite.identification.estimators.projection import ActiveSetProjector, Projector, distance_to_optimum
from excite.identification.estimators.scaled_problem import Ridge, ridge, scaled_parameters
from excite.identification.estimators.settings import (
    BodySettings,
    EstimatorSettings,
    ParameterBoundsSettings,
    PullSettings,
    SphereSettings,
    SymmetrySettings,
)
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

# The constrained quadratic program of eq. (4), Jovic et al., Humanoids 2015.

_MAX_ROUNDS = 60
_CONE_TOLERANCE = 1e-3


@dataclass(frozen=True)
class QpSettings(SymmetrySettings, BodySettings, SphereSettings, PullSettings):
    """Settings of ``qp``: the pull, boxes, symmetry, and the inertias' rows."""


class QuadraticProgram(Estimator[QpSettings]):
    """Least squares with a pull to the nominal model, under the linear constraints of Jovic et al. 2015.

    Channels are weighted as in ``wls``. Scaling of the pull: see
    :class:`~excite.identification.estimators.scaled_problem.Ridge`.
    """

    name: ClassVar[str] = "qp"
    title: ClassVar[str] = "constrained quadratic program of Jovic et al. 2015"
    use: ClassVar[str] = (
        "comparison with the paper: standard parameters near the nominal model, from short motions too; bodies that "
        "cannot exist are named in the result"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = QpSettings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; masses not negative, boxes of the centres of mass and "
        "positive definite inertias about the joint frames hold, the total mass where it was weighed or the record "
        "tells it, symmetry where it is asked for; the triangle inequality need not"
    )

    def __init__(self, projector: Projector | None = None):
        self._projector = projector

    def estimate(self, problem: IdentificationProblem, settings: QpSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        rows = iterate_weights(condense_problem(problem))
        objective = ridge(rows, settings)
        model = model_constraints(rows, settings)
        cone = inertia_cone(problem, settings.inertia_floor, settings.sphere_subdivisions)
        rotated, reached = objective.constraints(model.linear), None
        projector = self._projector or ActiveSetProjector()
        for _ in range(_MAX_ROUNDS):
            answer = projector(objective.target, rotated)
            if answer is None:
                raise _failure(rows, objective, model.linear, cone, SolveStatus.INFEASIBLE, None)
            reached = answer.z
            distance = distance_to_optimum(objective.target, rotated, answer)
            best = checked_estimate(self.name, rows, objective, answer.z, distance, rotated)
            best = replace(best, total_mass=model.total_mass)
            if best.status is not SolveStatus.SOLVED:
                raise _failure(rows, objective, model.linear, cone, best.status, reached)
            cuts = cone.cuts(best.parameters, _CONE_TOLERANCE)
            if not len(cuts.bound):
                return best
            rotated = stack_constraints([rotated, objective.constraints(cuts)], len(objective.target))
        raise _failure(rows, objective, model.linear, cone, SolveStatus.CUT_LIMIT, reached)


def _failure(
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    cone: InertiaCone,
    status: SolveStatus,
    answer: Array | None,
) -> NoSolutionError:
    """The error with the best point known."""
    rotated = objective.constraints(linear)

    def violations(z: Array) -> dict[str, float]:
        cuts = cone.cuts(objective.parameters(z), _CONE_TOLERANCE)
        both = stack_constraints([rotated, objective.constraints(cuts)], len(z))
        worst: dict[str, float] = {}
        for label, value in zip(both.labels, both.violations(z), strict=True):
            kind = label.split(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), float(value))
        return worst

    goals = [] if answer is None else [answer]
    best = best_known(QuadraticProgram.name, rows, objective, linear, goals, violations)
    # Nothing but a point that meets everything refutes a solver that finds none.
    if status is not SolveStatus.INFEASIBLE:
        best = replace(best, status=status)
    return no_solution(best.status, best)


# Parameters within bounds nearest to the unconstrained base solution (CLS-1 of Golluccio et al. 2020).

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
