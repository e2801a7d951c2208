"""The best point that meets the constraints, for when a solver has not found the optimum.

Constraints are convex: of the way from a point that meets them towards the optimum without constraints, a first
stretch meets them too, and the objective falls along it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.base import Estimate, SolveStatus
from excite.identification.estimators.ridge import Ridge
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression

_HALVINGS = 50
_FEASIBLE = 1e-8


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
    found = [start for start in starts if violation(start) <= _FEASIBLE]
    usable = [goal for goal in goals if np.isfinite(goal).all()]
    reached = [_furthest_feasible(start, goal, violation) for start in found for goal in usable]
    return min([*found, *reached], key=cost, default=None)


def _furthest_feasible(start: Array, goal: Array, violation: Callable[[Array], float]) -> Array:
    """The last point from ``start`` to ``goal`` that does not violate."""
    if violation(goal) <= _FEASIBLE:
        return goal
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if violation(start + middle * (goal - start)) <= _FEASIBLE:
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
    moving = np.zeros(problem.n_params, dtype=bool)
    moving[: problem.n_inertial] = True
    for segment in problem.unmeasured:
        moving[problem.robot.parameter_columns(segment)] = False
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
        rows: the rows as weighted.
        objective: what is to be small.
        linear: constraints on the parameters.
        goals: further points on the objective's coordinates, ``(n_free,)`` each, such as a solver's answer.
        violations: the largest of each kind at a point of these coordinates.

    Returns:
        An estimate with status NOT_OPTIMAL, or INFEASIBLE where no point is known.
    """

    def worst(z: Array) -> float:
        return max(violations(z).values(), default=0.0)

    def cost(z: Array) -> float:
        return float(np.linalg.norm(z - objective.target))

    starts = [objective.coordinates(model) for model in plain_models(rows.problem, linear)]
    z = best_feasible(starts, [objective.target, *goals], worst, cost)
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
