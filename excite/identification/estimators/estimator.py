"""What every estimator takes and gives; those there are, by name, are in ``registry``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import ClassVar, Generic, TypeVar

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.scaled_problem import Ridge
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.physical.retrieval import Certificate
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights

SettingsT = TypeVar("SettingsT", bound=EstimatorSettings)


class SolveStatus(Enum):
    """How a solve ended; the value is advice."""

    SOLVED = "solved: optimality and constraints were recomputed from the answer"
    INFEASIBLE = (
        "no parameters meet all constraints; check the total mass and the boxes of the centres of mass, "
        "or loosen the symmetry"
    )
    NOT_OPTIMAL = "the solver stopped short of the optimum; raise alpha or use another method"
    VIOLATED = "the solver's answer breaks constraints that it was given; do not use it, try another method"
    CUT_LIMIT = (
        "inertias were not positive on every vector within the allowed cuts; lower sphere_epsilon or use lmi"
    )
    NOT_FINITE = "the solver's answer is not finite; raise alpha or use another method"


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters found by an estimator, with checks that do not come from its solver.

    Attributes:
        method: registry name of the estimator.
        parameters: ``(n_params,)``.
        status: how the solve ended.
        regression: the rows as the estimator weighted them.
        residual: root mean square of the weighted residual.
        distance: bound on the distance to the optimum, in standard deviations of the noise (0 where there
            is no solver to distrust).
        violations: largest violation of each kind of constraint (kg, or kg·m, kg·m²).
        active: labels of constraints that hold with equality.
        total_mass: mass to which the sum was tied [kg], None where it was free.
        certificate: what is proven of an objective that is not convex, None for convex ones.
    """

    method: str
    parameters: Array
    status: SolveStatus
    regression: Regression
    residual: float
    distance: float = 0.0
    violations: dict[str, float] | None = None
    active: tuple[str, ...] = ()
    total_mass: float | None = None
    certificate: Certificate | None = None


class Estimator(ABC, Generic[SettingsT]):
    """A way to parameters from an :class:`~excite.identification.problem.IdentificationProblem`.

    A new one is a file with a subclass and a line in
    :mod:`excite.identification.estimators.registry`.

    Attributes:
        name: registry name.
        title: what it is, in a few words.
        use: when to take it, in a line.
        settings_class: its settings, all that it knows and none that it ignores.
        weighted: whether it takes channels as weighted by their own residuals.
        consistent: whether its parameters are those of bodies that can exist.
        adapts: whether :func:`~excite.identification.identify.identify` chooses the nominal model's weight, and terms
            beside rigid bodies, by blocks of the log that are left out.
        guarantees: what holds for every result that is returned, recomputed from the parameters themselves.
        exempt: checks of the shared battery in the tests that it does not claim to pass, with the reason.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    use: ClassVar[str]
    settings_class: ClassVar[type[EstimatorSettings]] = EstimatorSettings
    weighted: ClassVar[bool] = True
    consistent: ClassVar[bool] = False
    adapts: ClassVar[bool] = False
    guarantees: ClassVar[str] = ""
    exempt: ClassVar[Mapping[str, str]] = {}

    def estimate(self, problem: IdentificationProblem, settings: SettingsT) -> Estimate:
        """Estimate the parameters.

        Args:
            problem: the rows; not changed.
            settings: of its ``settings_class``.

        Returns:
            The estimate, its residual recomputed.

        Raises:
            InputError: rows are not finite.
            NoSolutionError: no parameters were found that pass the checks; ``best`` is the best Estimate.
        """
        rows = condense_problem(problem)
        return self.solve(iterate_weights(rows) if self.weighted else rows, settings)

    @abstractmethod
    def solve(self, rows: Regression, settings: SettingsT) -> Estimate:
        """As :meth:`estimate`, from rows that have been condensed and, where ``weighted``, weighted."""


# An estimate whose status comes from the answer itself, never from the solver that gave it.

# Largest accepted distance to the optimum, in standard deviations of the noise and, where the constraints
# pull far, as a share of that pull; largest accepted violation, in standard deviations.
DISTANCE_TOLERANCE = 1e-3
VIOLATION_TOLERANCE = 1e-5


def checked_estimate(
    method: str, rows: Regression, objective: Ridge, z: Array, distance: float, worst: dict[str, float]
) -> Estimate:
    """Residual and status of an answer.

    Args:
        method: name of the estimator.
        z: the answer, ``(n_free,)``.
        distance: bound on its distance to the optimum, in standard deviations of the noise.
        worst: its largest violation of each kind of constraint.
    """
    parameters = objective.parameters(z)
    status = SolveStatus.SOLVED
    if not np.isfinite(parameters).all() or not np.isfinite(distance):
        status = SolveStatus.NOT_FINITE
    elif max(worst.values(), default=0.0) > VIOLATION_TOLERANCE:
        status = SolveStatus.VIOLATED
    elif distance > DISTANCE_TOLERANCE * max(1.0, float(np.linalg.norm(z - objective.target))):
        status = SolveStatus.NOT_OPTIMAL
    return replace(estimate_at(method, rows, parameters, status, worst), distance=distance)


def finite_or_raised(best: Estimate) -> Estimate:
    """The estimate if it is finite; raises NoSolutionError with the nominal model otherwise."""
    if np.isfinite(best.parameters).all():
        return best
    status, rows = SolveStatus.NOT_FINITE, best.regression
    raise no_solution(status, estimate_at(best.method, rows, rows.problem.prior.copy(), status))


def no_solution(status: SolveStatus, best: Estimate) -> NoSolutionError:
    """The error of a failed solve, with advice.

    Args:
        status: how it failed; its value is the advice.
        best: the best estimate that is known.
    """
    reason = status.name.lower().replace("_", " ")
    return NoSolutionError(
        f"method {best.method} found no solution ({reason})", best=best, remedy=status.value
    )


# The best point that meets the constraints, for when a solver has not found the optimum.
#
# Constraints are convex: of the way from a point that meets them towards the optimum without constraints, a
# first stretch meets them too, and the objective falls along it.

_HALVINGS = 50
FEASIBLE = 1e-8


def best_feasible(
    starts: Sequence[Array],
    goals: Sequence[Array],
    violation: Callable[[Array], float],
    cost: Callable[[Array], float | tuple[float, ...]],
) -> Array | None:
    """The point of least cost among those that are reached from starts towards goals without a violation.

    Args:
        starts: points ``(n,)``; those that violate are left out.
        goals: points ``(n,)``; those that are not finite are left out.
        violation: largest violation at a point, of a convex set.
        cost: to be small.

    Returns:
        ``(n,)``; None where no start is feasible.
    """
    found = [start for start in starts if violation(start) <= FEASIBLE]
    usable = [goal for goal in goals if np.isfinite(goal).all()]
    reached = [_furthest_feasible(start, goal, violation) for start in found for goal in usable]
    return min([*found, *reached], key=cost, default=None)


def _furthest_feasible(start: Array, goal: Array, violation: Callable[[Array], float]) -> Array:
    """The last point from ``start`` to ``goal`` that does not violate."""
    if violation(goal) <= FEASIBLE:
        return goal
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if violation(start + middle * (goal - start)) <= FEASIBLE:
            low = middle
        else:
            high = middle
    return start + low * (goal - start)


def plain_models(problem: IdentificationProblem, linear: LinearConstraints) -> list[Array]:
    """The nominal model, and where the total mass is given the same bodies all heavier or lighter to meet it.

    Multiples of a body that can exist can exist, with the centre of mass where it was.

    Args:
        problem: the problem; segments that it does not measure keep their nominal parameters.
        linear: constraints on the parameters.

    Returns:
        Parameters, ``(n_params,)`` each.
    """
    models = [problem.prior.copy()]
    moving = problem.is_moving
    moving[problem.n_inertial :] = False
    for row, bound, label in zip(linear.matrix, linear.bound, linear.labels, strict=True):
        weight = float(row[moving] @ problem.prior[moving])
        if not label.startswith("total_mass") or weight == 0.0:
            continue
        factor = (bound - float(row[~moving] @ problem.prior[~moving])) / weight
        if factor > 0.0:
            models.append(np.where(moving, factor * problem.prior, problem.prior))
    return models


def best_known(
    method: str,
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    goals: Sequence[Array],
    violations: Callable[[Array], dict[str, float]],
) -> Estimate:
    """The best point known that meets the constraints, else the unconstrained optimum.

    Args:
        method: name of the estimator.
        objective: what is to be small.
        linear: constraints on the parameters.
        goals: further points on the objective's coordinates, ``(n_free,)`` each, such as a solver's answer.
        violations: the largest of each kind at a point of these coordinates.

    Returns:
        An estimate with status NOT_OPTIMAL, or INFEASIBLE where no point is known.
    """

    def worst_violation(z: Array) -> float:
        return max(violations(z).values(), default=0.0)

    def distance_to_target(z: Array) -> float:
        return float(np.linalg.norm(z - objective.target))

    starts = [objective.coordinates(model) for model in plain_models(rows.problem, linear)]
    z = best_feasible(starts, [objective.target, *goals], worst_violation, distance_to_target)
    status = SolveStatus.INFEASIBLE if z is None else SolveStatus.NOT_OPTIMAL
    z = objective.target if z is None else z
    return estimate_at(method, rows, objective.parameters(z), status, violations(z))


def estimate_at(
    method: str,
    rows: Regression,
    parameters: Array,
    status: SolveStatus,
    violations: dict[str, float] | None = None,
) -> Estimate:
    """Parameters with a status and the residual that they leave; nothing is said of their distance to the optimum."""
    weighted = rows.problem.residual(parameters) / rows.std[rows.problem.channel]
    residual = float(np.sqrt(np.mean(weighted**2)))
    return Estimate(method, parameters, status, rows, residual, float("inf"), violations)
