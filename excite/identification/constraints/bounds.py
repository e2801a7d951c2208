"""Lower and upper bounds on single parameters (Golluccio et al. 2020, CLS-1 and CLS-2)."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.problem import IdentificationProblem

MASS_AND_FIRST_MOMENT = (0, 1, 2, 3)


def default_bounds(problem: IdentificationProblem, spread: Array, width: float) -> Array:
    """Nominal values plus and minus ``width`` spreads, masses and drives' friction and armature not negative.

    Args:
        problem: the problem.
        spread: ``(n_params,)``.
        width: half width in spreads.

    Returns:
        ``(2, n_params)``.
    """
    bounds = problem.prior + width * spread * np.array([[-1.0], [1.0]])
    drives = ("viscous.", "coulomb.", "armature.")
    positive = [*range(0, problem.n_inertial, 10)]
    positive += [
        j
        for j in range(problem.n_inertial, problem.n_params)
        if problem.parameter_names[j].startswith(drives)
    ]
    bounds[0, positive] = np.maximum(bounds[0, positive], 0.0)
    return np.asarray(bounds)


def within_bounds(
    problem: IdentificationProblem, bounds: Array, places: tuple[int, ...] | None = None
) -> LinearConstraints:
    """``lower ≤ θ ≤ upper`` for every finite bound.

    Args:
        problem: the problem.
        bounds: ``(2, n_params)``.
        places: which of a segment's ten parameters, all parameters (drives' too) if None.

    Raises:
        InputError: bounds of another shape, NaN, or a lower one above its upper one.
    """
    bounds = np.asarray(bounds, dtype=float)
    if bounds.shape != (2, problem.n_params):
        raise InputError(
            f"has shape {bounds.shape}",
            source="settings",
            field="parameter_bounds",
            remedy=f"give (2, {problem.n_params})",
        )
    wrong = np.flatnonzero(~(bounds[0] <= bounds[1]))
    if len(wrong):
        raise InputError(
            f"leaves nothing for {problem.parameter_names[wrong[0]]}",
            source="settings",
            field="parameter_bounds",
        )
    columns = np.arange(problem.n_params)
    if places is not None:
        columns = columns[: problem.n_inertial]
        columns = columns[np.isin(columns % 10, places)]
    identity = np.eye(problem.n_params)[columns]
    lower, upper = bounds[0, columns], bounds[1, columns]
    below, above = np.isfinite(lower), np.isfinite(upper)
    names = np.array(problem.parameter_names)[columns]
    labels = [f"bounds:{name}" for name in (*names[below], *names[above])]
    return LinearConstraints(
        np.vstack([identity[below], -identity[above]]),
        np.concatenate([lower[below], -upper[above]]),
        tuple(labels),
    )
