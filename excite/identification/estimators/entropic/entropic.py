"""Least squares with the entropic divergence from the nominal bodies, by a primal-dual Newton method.

In the coordinates of the pullback ridge the objective is ``½‖z − d‖² + Σ wᵢ gᵢ(z)``, where ``g`` is what the
divergence adds to its own second order, so the first Newton step is the pullback solution.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_solve

from excite.identification.constraints.body import moving_segments
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.base import Estimate, SolveStatus
from excite.identification.estimators.checked import checked_estimate, no_solution
from excite.identification.estimators.entropic.entropic_newton import safe_cholesky
from excite.identification.estimators.entropic.entropic_problem import (
    EntropicAnswer,
    EntropicProblem,
    EntropicSolver,
)
from excite.identification.estimators.entropic.geometric import relative_map
from excite.identification.estimators.fallback import best_known
from excite.identification.estimators.ridge import Ridge
from excite.identification.estimators.settings import PullSettings
from excite.identification.regression import Regression


def entropic_distance(problem: EntropicProblem, answer: EntropicAnswer) -> float:
    """Distance to the optimum by its gradient and gap in the local metric, which is exact to second order."""
    e = problem.linear.n_equal
    multipliers = answer.multipliers.copy()
    multipliers[e:] = np.maximum(multipliers[e:], 0.0)
    left = problem.gradient(answer.z) - problem.linear.matrix.T @ multipliers
    slack = problem.linear.matrix @ answer.z - problem.linear.bound
    gap = abs(float(multipliers @ slack))
    factor = safe_cholesky(problem.hessian(answer.z))
    if factor is None:
        return np.inf
    newton_step = cho_solve(factor, left)
    return float(np.sqrt(abs(left @ newton_step) + 2.0 * gap))


def entropic_estimate(
    method: str,
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    settings: PullSettings,
    solver: EntropicSolver,
) -> Estimate:
    """Estimate with the entropic divergence; ``objective`` is the ridge with the pullback metric.

    Raises:
        NoSolutionError: no parameters meet the constraints, or an answer fails its recomputation.
    """
    source = rows.problem
    segments = moving_segments(source)
    relative = relative_map(source)
    maps = np.zeros((len(segments), 10, source.n_params))
    for place, k in enumerate(segments):
        maps[place, :, 10 * k : 10 * k + 10] = relative[k]
    turned = objective.rotate(maps.reshape(-1, source.n_params)).reshape(*maps.shape[:2], -1)
    weights = settings.alpha / (4.0 * settings.spreads(source.robot)[list(segments)] ** 2)
    problem = EntropicProblem(objective.target, turned, weights, objective.constraints(linear))
    answer = solver(problem)
    if answer is None:
        best = best_known(method, rows, objective, linear, [], problem.violations)
        raise no_solution(best.status, best)
    usable = np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all()
    inside = usable and np.linalg.eigvalsh(problem.relative(answer.z))[:, 0].min(initial=1.0) > 0.0
    distance = entropic_distance(problem, answer) if inside else np.inf
    best = checked_estimate(method, rows, objective, answer.z, distance, problem.linear)
    if best.status is not SolveStatus.SOLVED:
        known = best_known(method, rows, objective, linear, [answer.z], problem.violations)
        raise no_solution(best.status, replace(known, status=best.status))
    return best
