"""Nearest points under linear constraints, and how far an answer is from the true one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr_delete, solve_triangular

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints


@dataclass(frozen=True, eq=False)
class ProjectionAnswer:
    """What a solver says is the point nearest to the target, and its multipliers.

    Attributes:
        z: ``(n,)``.
        multipliers: ``(n_rows,)``, one per constraint, then those of cones' entries; of inequalities not negative.
        infeasible: whether it says that there is no point.
    """

    z: Array
    multipliers: Array
    infeasible: bool = False


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


# Nearest points under linear rows to which more rows are added, each time from where the last answer stood.

_DEPENDENT = 1e-11
_VIOLATED = 1e-12
# Rows that differ by rounding are the same.
_SAME = 1e-13
_STEPS_PER_ROW = 20


class ActiveSetProjector:
    """Goldfarb and Idnani's dual method (1983) with memory.

    Called with the target of the last call and rows that begin with the last ones, it goes on from its last
    active set, which costs as many steps as the new rows bring; otherwise it starts anew.
    """

    def __init__(self) -> None:
        # None where there is nothing to go on from: at first, and after a search that failed.
        self._target: Array | None = None
        self._rows = LinearConstraints(np.zeros((0, 0)), np.zeros(0), ())
        self._set = _ActiveSet(np.zeros(0))

    def __call__(self, target: Array, constraints: LinearConstraints) -> ProjectionAnswer | None:
        """The point nearest to ``target`` that meets constraints; None where it finds none."""
        known = len(self._rows.bound)
        if not (
            self._target is not None
            and np.array_equal(target, self._target)
            and known <= len(constraints.bound)
            and constraints.n_equal == self._rows.n_equal
            and np.allclose(constraints.bound[:known], self._rows.bound, rtol=0.0, atol=_SAME)
            and np.allclose(constraints.matrix[:known], self._rows.matrix, rtol=0.0, atol=_SAME)
        ):
            self._set = _ActiveSet(target)
        self._target, self._rows = target, constraints
        answer = self._set.project(constraints)
        if answer is None:
            self._target = None
        return answer


class _ActiveSet:
    """Rows that hold with equality, their orthogonal factors and multipliers.

    ``q`` and ``r`` are the factors of the active rows' normals; the point is optimal for the active rows alone.
    """

    def __init__(self, target: Array):
        self.point = target.copy()
        self.active: list[int] = []
        self.sign: list[float] = []
        self.load = np.zeros(0)
        self.q, self.r = np.zeros((len(target), 0)), np.zeros((0, 0))

    def project(self, rows: LinearConstraints) -> ProjectionAnswer | None:
        for k in range(rows.n_equal):
            if k not in self.active and not self._add_row(rows, k):
                return None
        limit = _STEPS_PER_ROW * (len(rows.bound) + 1)
        for _ in range(limit):
            slack = rows.matrix @ self.point - rows.bound
            slack[self.active] = np.inf
            worst = int(np.argmin(slack)) if len(slack) else -1
            if worst < 0 or slack[worst] >= -_VIOLATED:
                multipliers = np.zeros(len(rows.bound))
                multipliers[self.active] = self.load * self.sign
                return ProjectionAnswer(self.point.copy(), multipliers)
            if not self._add_row(rows, worst):
                return None
        return None

    def _add_row(self, rows: LinearConstraints, k: int) -> bool:
        """Make a violated row hold, dropping rows that stand against it; False where nothing can."""
        slack = float(rows.matrix[k] @ self.point - rows.bound[k])
        # An equality that is exceeded is a row that is violated the other way.
        sign = -1.0 if k < rows.n_equal and slack > 0.0 else 1.0
        normal, missing, gained = sign * rows.matrix[k], max(-sign * slack, 0.0), 0.0
        while True:
            along = self.q.T @ normal
            across = normal - self.q @ along
            extra = self.q.T @ across
            across -= self.q @ extra
            along += extra
            height = float(across @ across)
            back = solve_triangular(self.r, along, check_finite=False) if len(along) else along
            blocking = back > 1e-14
            blocking[[place for place, row in enumerate(self.active) if row < rows.n_equal]] = False
            ratios = np.where(blocking, self.load / np.where(blocking, back, 1.0), np.inf)
            first = int(np.argmin(ratios)) if len(ratios) else -1
            partial = float(ratios[first]) if first >= 0 else np.inf
            free = height > _DEPENDENT**2
            full = missing / height if free else np.inf
            step = min(partial, full)
            if not np.isfinite(step):
                # An equality that the others imply adds nothing.
                return k < rows.n_equal and missing < 1e-9
            self.load = self.load - step * back
            gained += step
            if free:
                self.point = self.point + step * across
                missing -= step * height
            if full <= partial:
                count = len(self.active)
                grown = np.zeros((count + 1, count + 1))
                grown[:count, :count] = self.r
                grown[:count, count], grown[count, count] = along, np.sqrt(height)
                self.q, self.r = np.column_stack([self.q, (across / np.sqrt(height))]), grown
                self.active.append(k)
                self.sign.append(sign)
                self.load = np.append(self.load, gained)
                return True
            self._drop_row(first)

    def _drop_row(self, place: int) -> None:
        if len(self.active) == 1:
            self.q, self.r = self.q[:, :0], np.zeros((0, 0))
        else:
            self.q, self.r = qr_delete(self.q, self.r, place, which="col", check_finite=False)
            count = len(self.active) - 1
            self.q, self.r = (
                np.ascontiguousarray(self.q[:, :count]),
                np.ascontiguousarray(self.r[:count, :count]),
            )
        del self.active[place], self.sign[place]
        self.load = np.delete(self.load, place)
