"""Nearest points where some coordinates do not count: ``min ½‖p − t‖²`` over ``(p, n)`` with linear rows.

The coordinates ``n`` make the problem singular. A proximal term on them gives a projection whose active rows
are then solved exactly, without the term; where that answer is optimal it is the answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.quadratic.active_set import ActiveSetProjector
from excite.identification.estimators.quadratic.projection import Projector
from excite.identification.orthogonal import row_space

WEAK = 1e-8
_EMPTY = 1e-9
_DEPENDENT = 1e-8
_TOUCH = 1e-11
_EXCHANGES = 20


@dataclass(frozen=True, eq=False)
class SemiProjection:
    """``min ½‖p − target‖²`` with ``counted · p + free · n ≥ bound``, the first ``n_equal`` rows equalities.

    Attributes:
        target: ``(k,)``.
        counted: ``(m, k)``.
        free: ``(m, j)``.
        bound: ``(m,)``.
        n_equal: number of equalities.
    """

    target: Array
    counted: Array
    free: Array
    bound: Array
    n_equal: int

    def extended(self, counted: Array, free: Array, bound: Array) -> SemiProjection:
        """With more inequalities."""
        return replace(
            self,
            counted=np.vstack([self.counted, counted]),
            free=np.vstack([self.free, free]),
            bound=np.concatenate([self.bound, bound]),
        )

    @property
    def sizes(self) -> Array:
        """Length by which a violation of each row is divided, ``(m,)``."""
        return np.asarray(
            np.maximum(
                np.hypot(*(np.linalg.norm(part, axis=1) for part in (self.counted, self.free))), _EMPTY
            )
        )


@dataclass(frozen=True, eq=False)
class SemiAnswer:
    """A point and multipliers, with what they are worth.

    Attributes:
        p: ``(k,)``.
        n: ``(j,)``.
        multipliers: ``(m,)``.
        violation: largest violation of a row divided by its length.
        gap: bound on the duality gap, with ``n`` no farther from the optimum than it is long.
    """

    p: Array
    n: Array
    multipliers: Array
    violation: float
    gap: float

    @property
    def distance(self) -> float:
        """Bound on the distance of ``p`` from the optimum."""
        return float(np.sqrt(2.0 * self.gap))


def judged(problem: SemiProjection, p: Array, n: Array, multipliers: Array) -> SemiAnswer:
    """Recompute violation and gap of an answer, wherever it comes from."""
    slack = problem.counted @ p + problem.free @ n - problem.bound
    below = np.maximum(-slack, 0.0)
    below[: problem.n_equal] = np.abs(slack[: problem.n_equal])
    sign = multipliers.copy()
    sign[problem.n_equal :] = np.maximum(sign[problem.n_equal :], 0.0)
    pull = p - problem.target - problem.counted.T @ sign
    drift = float(np.linalg.norm(problem.free.T @ sign)) * (1.0 + float(np.linalg.norm(n)))
    gap = 0.5 * float(pull @ pull) + float(np.abs(sign * slack).sum()) + drift
    if not np.isfinite(gap):
        gap = np.inf
    return SemiAnswer(p, n, multipliers, float((below / problem.sizes).max(initial=0.0)), gap)


def semi_project(
    problem: SemiProjection, start: Array, projector: Projector, weak: float = WEAK
) -> SemiAnswer | None:
    """One proximal step from ``start``; None where the solver finds no point.

    Args:
        problem: the problem.
        start: ``(j,)`` where the proximal term is centred.
        projector: finds nearest points; not trusted.
        weak: weight of the proximal term; small, so that the active rows are those of the problem without it.
    """
    k, root = len(problem.target), np.sqrt(weak)
    rows = np.hstack([problem.counted, problem.free / root])
    bound = problem.bound - problem.free @ start
    length = np.linalg.norm(rows, axis=1)
    kept = length > _EMPTY
    size = length[kept]
    listed = LinearConstraints(
        rows[kept] / size[:, None], bound[kept] / size, ("",) * len(size), int(kept[: problem.n_equal].sum())
    )
    answer = projector(np.concatenate([problem.target, np.zeros(len(start))]), listed)
    if answer is None:
        return None
    multipliers = np.zeros(len(kept))
    multipliers[kept] = answer.multipliers / size
    return judged(problem, answer.z[:k], start + answer.z[k:] / root, multipliers)


def completed(problem: SemiProjection, near: SemiAnswer) -> SemiAnswer:
    """The optimum itself from a proximal answer, where its active rows lead there; else that answer."""
    if not np.isfinite(near.gap):
        return near
    exact = pursue(problem, near.multipliers > 0.0, near.n)
    return near if exact is None or exact.gap > near.gap else exact


def pursue(problem: SemiProjection, active: NDArray[np.bool_], start: Array) -> SemiAnswer | None:
    """Solve active rows as equalities, exchange rows by their signs, until multipliers and slacks agree.

    The primal-dual active-set method (Hintermüller, Ito and Kunisch 2003) from a good guess; None where it does
    not settle, in which case another method has to.

    Args:
        problem: the problem.
        active: ``(m,)`` guess of the rows that are active.
        start: ``(j,)`` the answer's free coordinates are the nearest to it.
    """
    active = active.copy()
    active[: problem.n_equal] = True
    sizes = problem.sizes
    for _ in range(_EXCHANGES):
        answer = _with_active(problem, active, start)
        if not np.isfinite(answer.gap):
            return None
        slack = (problem.counted @ answer.p + problem.free @ answer.n - problem.bound) / sizes
        load = answer.multipliers * sizes
        pushed = active & (load < -1e-11 * max(1.0, float(np.abs(load).max(initial=0.0))))
        pushed[: problem.n_equal] = False
        broken = ~active & (slack < -_TOUCH)
        if not pushed.any():
            if broken.any():
                answer = _with_room(problem, answer, active) or answer
            if answer.violation < 10.0 * _TOUCH:
                return answer
        active = (active & ~pushed) | broken
    return None


def _with_room(problem: SemiProjection, answer: SemiAnswer, active: NDArray[np.bool_]) -> SemiAnswer | None:
    """The same ``p`` with free coordinates that meet every row, where there are any."""
    loaded = active & (answer.multipliers * problem.sizes > 1e-9)
    loaded[: problem.n_equal] = True
    space = row_space(problem.free[loaded], _DEPENDENT)
    rows = problem.free[~loaded] @ space.null
    length = np.linalg.norm(rows, axis=1)
    kept = length > _EMPTY
    bound = (problem.bound - problem.counted @ answer.p - problem.free @ answer.n)[~loaded][kept]
    listed = LinearConstraints(rows[kept] / length[kept, None], bound / length[kept], ("",) * int(kept.sum()))
    moved = ActiveSetProjector()(np.zeros(rows.shape[1]), listed)
    if moved is None:
        return None
    return judged(problem, answer.p, answer.n + space.null @ moved.z, answer.multipliers)


def _with_active(problem: SemiProjection, active: NDArray[np.bool_], start: Array) -> SemiAnswer:
    """The optimum with active rows as equalities and no others."""
    size = problem.sizes[active]
    counted, free = problem.counted[active] / size[:, None], problem.free[active] / size[:, None]
    bound = problem.bound[active] / size
    # Stationarity in n: multipliers are combinations W of rows in which the free coordinates cancel.
    cancels = row_space(free.T, _DEPENDENT).null
    reduced = row_space((cancels.T @ counted).T, _DEPENDENT)
    gap = cancels.T @ (bound - counted @ problem.target)
    solved = cancels @ (reduced.inverse @ (reduced.inverse.T @ gap))
    p = problem.target + counted.T @ solved
    space = row_space(free, _DEPENDENT)
    n = start + space.inverse @ (space.image.T @ (bound - counted @ p - free @ start))
    multipliers = np.zeros(len(active))
    multipliers[active] = solved / size
    return judged(problem, p, n, multipliers)
