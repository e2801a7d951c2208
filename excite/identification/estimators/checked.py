"""An estimate whose status comes from the answer itself, never from the solver that gave it."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.base import Estimate, SolveStatus
from excite.identification.estimators.fallback import estimate_at
from excite.identification.estimators.ridge import Ridge
from excite.identification.regression import Regression

# Largest accepted distance to the optimum, in standard deviations of the noise and, where the constraints
# pull far, as a share of that pull; largest accepted violation, in standard deviations.
DISTANCE_TOLERANCE = 1e-3
VIOLATION_TOLERANCE = 1e-5


def checked_estimate(
    method: str,
    rows: Regression,
    objective: Ridge,
    z: Array,
    distance: float,
    constraints: LinearConstraints,
) -> Estimate:
    """Residual, violations and status of an answer.

    Args:
        method: name of the estimator.
        rows: the rows as weighted.
        objective: the objective.
        z: the answer, ``(n_free,)``.
        distance: bound on its distance to the optimum, in standard deviations of the noise.
        constraints: what it should meet, rows of unit length on ``z``.
    """
    problem = rows.problem
    parameters = objective.parameters(z)
    violation = constraints.violations(z)
    kinds = [label.split(":")[0] for label in constraints.labels]
    worst = dict.fromkeys(kinds, 0.0)
    for kind, value in zip(kinds, violation, strict=True):
        worst[kind] = max(worst[kind], float(value))
    status = SolveStatus.SOLVED
    if not np.isfinite(parameters).all() or not np.isfinite(distance):
        status = SolveStatus.NOT_FINITE
    elif max(worst.values(), default=0.0) > VIOLATION_TOLERANCE:
        status = SolveStatus.VIOLATED
    elif distance > DISTANCE_TOLERANCE * max(1.0, float(np.linalg.norm(z - objective.target))):
        status = SolveStatus.NOT_OPTIMAL
    slack = constraints.matrix @ z - constraints.bound
    active = [label for label, s in zip(constraints.labels, slack, strict=True) if s < VIOLATION_TOLERANCE]
    weighted = problem.residual(parameters) / rows.std[problem.channel]
    return Estimate(
        method=method,
        parameters=parameters,
        status=status,
        regression=rows,
        residual=float(np.sqrt(np.mean(weighted**2))),
        distance=distance,
        violations=worst,
        active=tuple(dict.fromkeys(active)),
    )


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
