"""Nearest points by a solver that is none of the package's, to compare with."""

from __future__ import annotations

import daqp
import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.projection import ProjectionAnswer

# Codes of DAQP, and tolerances for rows of length one.
_EQUALITY, _SOLVED = 5, 1
_EXACT = {"primal_tol": 1e-12, "dual_tol": 1e-12}


def project(target: Array, constraints: LinearConstraints) -> ProjectionAnswer | None:
    """The point nearest to ``target`` that meets constraints, by a dual active set (DAQP).

    Returns:
        The answer, None where the solver finds the constraints inconsistent.
    """
    if not len(constraints.bound):
        return ProjectionAnswer(target.copy(), np.zeros(0))
    kinds = np.zeros(len(constraints.bound), dtype=np.int32)
    kinds[: constraints.n_equal] = _EQUALITY
    upper = np.full(len(constraints.bound), np.inf)
    upper[: constraints.n_equal] = constraints.bound[: constraints.n_equal]
    z, _, ending, told = daqp.solve(
        np.eye(len(target)),
        -target,
        np.ascontiguousarray(constraints.matrix),
        upper,
        constraints.bound,
        kinds,
        **_EXACT,
    )
    if ending != _SOLVED:
        return None
    return ProjectionAnswer(np.array(z), -np.array(told["lam"]))
