"""Nearest points under linear constraints, and how far an answer is from the true one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints


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
