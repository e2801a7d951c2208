"""From an objective, constraints and a conic solver to an estimate that has been checked."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from excite.identification.constraints.body import ParameterCones
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.base import Estimate, SolveStatus
from excite.identification.estimators.checked import VIOLATION_TOLERANCE, checked_estimate, no_solution
from excite.identification.estimators.conic.conic import (
    ConicAnswer,
    ConicProblem,
    ConicSolver,
    conic_distance,
    conic_violations,
    refine_answer,
    stack_rows,
)
from excite.identification.estimators.fallback import best_known
from excite.identification.estimators.ridge import Ridge
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.regression import Regression

# What rounding may leave of a pseudo-inertia that must be positive semidefinite (kg, kg·m, kg·m²).
EIGENVALUE_TOLERANCE = 1e-9
_RAY = 1e-6


def conic_estimate(
    method: str,
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    cones: tuple[ParameterCones, ...],
    solver: ConicSolver,
) -> Estimate:
    """The objective's least value under linear constraints and cones on the parameters.

    Args:
        method: name of the estimator.
        rows: the rows as weighted.
        objective: the objective.
        linear: on the parameters.
        cones: on the parameters.
        solver: finds the optimum; not trusted.

    Raises:
        NoSolutionError: no point, or an answer that its recomputation refuses; ``best`` is the best point known
            that meets the constraints, the unconstrained optimum where there is none.
    """
    problem = ConicProblem(
        objective.target, objective.constraints(linear), tuple(objective.cones(part) for part in cones)
    )
    answer = solver(problem)
    if answer.infeasible:
        proven = _is_ray(problem, answer)
        status = SolveStatus.INFEASIBLE if proven else SolveStatus.NOT_OPTIMAL
        known = best_known(method, rows, objective, linear, [], partial(conic_violations, problem))
        raise no_solution(status, replace(known, status=status))
    if np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all():
        try:
            answer = refine_answer(problem, answer)
        except LinAlgError:
            # The answer stands as it is; its distance decides.
            pass
    distance = conic_distance(problem, answer)
    best = checked_estimate(method, rows, objective, answer.z, distance, problem.linear)
    best = replace(best, violations=conic_violations(problem, answer.z) if np.isfinite(distance) else {})
    if (
        best.status is SolveStatus.SOLVED
        and max((best.violations or {}).values(), default=0.0) > VIOLATION_TOLERANCE
    ):
        best = replace(best, status=SolveStatus.VIOLATED)
    if best.status is not SolveStatus.SOLVED:
        violations = partial(conic_violations, problem)
        known = best_known(method, rows, objective, linear, [answer.z], violations)
        raise no_solution(best.status, replace(known, status=best.status))
    return best


def consistent_or_raised(best: Estimate) -> Estimate:
    """The estimate if every pseudo-inertia, recomputed, is positive semidefinite; raises NoSolutionError otherwise."""
    least = np.linalg.eigvalsh(pseudo_inertia_matrices(best.parameters[: best.regression.problem.n_inertial]))
    moving = np.ones(len(least), dtype=bool)
    moving[list(best.regression.problem.unmeasured)] = False
    if least[moving, 0].min(initial=0.0) < -EIGENVALUE_TOLERANCE:
        raise no_solution(SolveStatus.VIOLATED, replace(best, status=SolveStatus.VIOLATED))
    return best


def _is_ray(problem: ConicProblem, answer: ConicAnswer) -> bool:
    """Whether multipliers prove that there is no point: ``λ`` in the dual cone, ``Mᵀλ = 0``, ``λᵀc < 0``."""
    matrix, offset = stack_rows(problem)
    ray = answer.multipliers
    if not np.isfinite(ray).all():
        return False
    value = float(ray @ offset)
    return value < 0.0 and float(np.linalg.norm(matrix.T @ ray)) < _RAY * abs(value)
