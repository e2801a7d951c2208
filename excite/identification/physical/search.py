"""Descent to a local optimum of the retrieval: Gauss-Newton steps over the feasible set (Levenberg 1944)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.physical.feasible_set import FeasibleSet
from excite.identification.physical.relaxation import Relaxation

_ITERATIONS = 80
_GAIN = 1e-7
_LARGEST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """Where a descent ended.

    Attributes:
        x: ``(size,)`` coordinates in the feasible set.
        objective: ``f`` of eq. (15) there [N·m].
        iterations: Gauss-Newton steps taken.
    """

    x: Array
    objective: float
    iterations: int


def descend_locally(problem: Relaxation, start: Array) -> LocalOptimum:
    """Minimise eq. (15), with the problem's slight pull to its center, from a point of the feasible set.

    Each step minimises the linearised objective with a damping over the whole set, which is convex, so that
    every iterate is allowed.

    Args:
        problem: objective, set and pull; its relaxation is not used.
        start: ``(size,)`` in the set.
    """
    allowed, objective = problem.allowed, problem.objective
    lifted = objective.factor @ allowed.lift
    target = objective.target - objective.factor @ allowed.offset

    def residual(x: Array) -> Array:
        return np.asarray(lifted @ np.concatenate([x, allowed.moments(x)]) - target)

    def cost(x: Array) -> float:
        rest, pull = residual(x), problem.weight * (x - problem.center)
        return 0.5 * float(rest @ rest + pull @ pull)

    x, damping, iterations = start, 1e-2, 0
    best = cost(x)
    # What matters is the objective with its floor: changes far below it are of no interest.
    small = _GAIN * max(0.5 * objective.floor**2, 1e-9 * 0.5 * float(target @ target))
    for _ in range(_ITERATIONS):
        iterations += 1
        rest, slope = residual(x), lifted @ _lift_derivative(allowed, x)
        gained = 0.0
        while damping < _LARGEST_DAMPING:
            pull = np.sqrt(problem.weight**2 + damping / allowed.scale**2)
            centre = (problem.weight**2 * problem.center + damping / allowed.scale**2 * x) / pull**2
            trial = allowed.step(slope, slope @ x - rest, pull, centre)
            step, offset = trial - x, problem.weight * (trial - problem.center)
            ahead = rest + slope @ step
            predicted = best - 0.5 * float(ahead @ ahead + offset @ offset)
            gained = best - cost(trial)
            if predicted < small or gained > 0.1 * predicted:
                break
            damping *= 4.0
        if gained > 0.0:
            x, best = trial, best - gained
        if predicted < small or gained < small:
            break
        if gained > 0.7 * predicted:
            damping = max(damping / 4.0, 1e-9)
    return LocalOptimum(x, objective.value(allowed.standard(x)), iterations)


def _lift_derivative(allowed: FeasibleSet, x: Array) -> Array:
    """Derivative of ``(x, hhᵀ/m)`` by ``x``, ``(size + 6·n_free, size)``."""
    matrix = np.zeros((allowed.lift.shape[1], allowed.size))
    matrix[: allowed.size] = np.eye(allowed.size)
    for place, (mass, *first) in enumerate(x[: allowed.n_body].reshape(-1, 10)[:, :4]):
        body, moments, c = 10 * place, allowed.size + 6 * place, np.array(first) / mass
        for k, (p, q) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
            matrix[moments + k, body] = -c[p] * c[q]
            matrix[moments + k, body + 1 + p] += c[q]
            matrix[moments + k, body + 1 + q] += c[p]
    return matrix
