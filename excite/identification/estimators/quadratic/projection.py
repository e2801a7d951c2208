"""Nearest points under linear constraints, and how far an answer is from the true one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import quadprog

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.regression import minimum_norm


@dataclass(frozen=True, eq=False)
class ProjectionAnswer:
    """What a solver says is the point nearest to the target, and its multipliers.

    Attributes:
        z: ``(n,)``.
        multipliers: ``(n_rows,)``, one per constraint; those of inequalities are not negative.
    """

    z: Array
    multipliers: Array


Projector = Callable[[Array, LinearConstraints], "ProjectionAnswer | None"]


def project(target: Array, constraints: LinearConstraints) -> ProjectionAnswer | None:
    """The point nearest to ``target`` that meets constraints, by Goldfarb and Idnani's method (quadprog).

    Returns:
        The answer, None where the solver finds the constraints inconsistent.
    """
    identity = np.eye(len(target))
    if not len(constraints.bound):
        return ProjectionAnswer(target.copy(), np.zeros(0))
    try:
        answer = quadprog.solve_qp(
            identity, target, constraints.matrix.T.copy(), constraints.bound, constraints.n_equal, True
        )
    except ValueError:
        return None
    multipliers = np.array(answer[4])
    # quadprog gives multipliers of equalities without their sign: stationarity tells it.
    if constraints.n_equal:
        pull = (
            answer[0]
            - target
            - constraints.matrix[constraints.n_equal :].T @ multipliers[constraints.n_equal :]
        )
        multipliers[: constraints.n_equal] = minimum_norm(constraints.matrix[: constraints.n_equal].T, pull)
    return ProjectionAnswer(answer[0], multipliers)


def distance_to_optimum(target: Array, constraints: LinearConstraints, answer: ProjectionAnswer) -> float:
    """Bound on the distance from an answer to the true projection, from its duality gap.

    With ``½‖z − d‖²`` the gap of a point and multipliers λ is ``½‖z − d − Cᵀλ‖² + λᵀ(Cz − b)``; the
    distance is at most ``√(2·gap)``. Nothing that the solver says of itself is used.
    """
    multipliers = answer.multipliers.copy()
    multipliers[constraints.n_equal :] = np.maximum(multipliers[constraints.n_equal :], 0.0)
    stationarity = answer.z - target - constraints.matrix.T @ multipliers
    slack = constraints.matrix @ answer.z - constraints.bound
    gap = 0.5 * float(stationarity @ stationarity) + abs(float(multipliers @ slack))
    return float(np.sqrt(2.0 * max(gap, 0.0)))
