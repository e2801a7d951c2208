"""Lexicographic least squares: levels of constraints, then a fit, then the nearest point (Escande et al. 2014).

A level's constraints are met with the least sum of squared violations that the levels above allow, and what
it has reached is then kept exactly: violations at an optimum are unique, so each violated row becomes an
equality, and so does each row that a positive multiplier shows to be active at every optimum. All that is
left is a smaller space and rows that hold. Every answer of a solver is recomputed before it is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.base import SolveStatus
from excite.identification.estimators.quadratic.hierarchy_state import (
    EMPTY,
    HierarchyAnswer,
    HierarchyState,
    Level,
    LevelFailed,
)
from excite.identification.estimators.quadratic.projection import (
    ProjectionAnswer,
    Projector,
    distance_to_optimum,
)
from excite.identification.estimators.quadratic.semi_projection import (
    WEAK,
    SemiAnswer,
    SemiProjection,
    completed,
    semi_project,
)
from excite.identification.orthogonal import row_space

Mask = NDArray[np.bool_]

# Rows have unit length on the scaled parameters: a violation is a share of a parameter's spread.
_FEASIBLE = 1e-8
_VIOLATED = 1e-7
_ACTIVE = 1e-9
_MAX_ROUNDS = 60
_LEAST_WEAK = 1e-13
# Accepted distance to a level's optimum, as a share of the distance that the constraints enforce.
_DISTANCE = 1e-5
_COARSE_DISTANCE = 1e-3


def solve_hierarchy(
    levels: tuple[Level, ...],
    matrix: Array,
    measured: Array,
    projector: Projector,
    start: Array | None = None,
) -> HierarchyAnswer:
    """``levels ≻ (matrix · x = measured) ≻ (x = 0)`` (eq. 7 of Jovic et al. 2016).

    Args:
        levels: constraint levels, most important first.
        matrix: rows of the fit ``(k, n)``.
        measured: ``(k,)``.
        projector: finds nearest points; not trusted.
        start: a point that meets most rows, ``(n,)``; it does not change the optimum.
    """
    n = matrix.shape[1]
    state = HierarchyState(
        np.zeros(n) if start is None else start.copy(), np.eye(n), stack_constraints([], n)
    )
    slacks: list[float] = []
    fit_distance = distance = np.inf
    status = SolveStatus.SOLVED
    try:
        for level in levels:
            slacks.append(_meet(state, level, projector))
        fit_distance = _fit(state, matrix, measured, projector)
        distance = _nearest(state, projector)
    except LevelFailed as failure:
        status = failure.status
    return HierarchyAnswer(state.x, status, tuple(slacks), fit_distance, distance)


def _meet(state: HierarchyState, level: Level, projector: Projector) -> float:
    """Meet a level as well as the levels above allow; returns the norm of what is violated."""
    rows, n = level.constraints, len(state.x)
    for _ in range(_MAX_ROUNDS):
        both = stack_constraints([state.hard, rows], n)
        matrix = both.matrix @ state.basis
        bound = both.bound - both.matrix @ state.x
        length = np.linalg.norm(matrix, axis=1)
        if np.abs(bound[length <= EMPTY]).max(initial=0.0) > _FEASIBLE and both.n_equal:
            break
        kept = length > EMPTY
        listed = LinearConstraints(
            matrix[kept] / length[kept, None],
            bound[kept] / length[kept],
            ("",) * int(kept.sum()),
            int(kept[: both.n_equal].sum()),
        )
        answer = projector(np.zeros(matrix.shape[1]), listed)
        if answer is None or not _finite(answer):
            break
        x = state.x + state.basis @ answer.z
        if both.violations(x).max(initial=0.0) > _FEASIBLE:
            break
        above, found = state.violated(x), _violated(level, x)
        if not len(above.bound) and not len(found.bound):
            state.x = x
            _keep(state, level, rows, np.arange(len(rows.bound)) < rows.n_equal)
            return 0.0
        state.add(above)
        rows = stack_constraints([rows, found], n)
    return _least_violation(state, level, rows, projector)


def _violated(level: Level, x: Array) -> LinearConstraints:
    return stack_constraints([], len(x)) if level.family is None else level.family.violated(x)


def _finite(answer: ProjectionAnswer) -> bool:
    return bool(np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all())


def _keep(state: HierarchyState, level: Level, rows: LinearConstraints, pinned: Mask) -> None:
    """Keep what the present point reaches: pinned rows as equalities, the others as they are or better."""
    if level.family is not None:
        state.families.append(level.family)
    state.pin(rows.only(pinned))
    state.add(rows.only(~pinned))


def _least_violation(
    state: HierarchyState, level: Level, rows: LinearConstraints, projector: Projector
) -> float:
    """``min ‖w‖²`` with ``A u + w ≥ b``; what is violated at the optimum is pinned."""
    u = np.zeros(state.basis.shape[1])
    for _ in range(_MAX_ROUNDS):
        k, e, h = len(rows.bound), rows.n_equal, len(state.hard.bound)
        equal = LinearConstraints(rows.matrix[:e], rows.bound[:e], rows.labels[:e], e)
        joined = stack_constraints([equal, state.hard, rows.only(np.arange(k) >= e)], len(state.x))
        counted = np.zeros((k + h, k))
        counted[:e, :e] = np.eye(e)
        counted[e + h :, e:] = np.eye(k - e)
        problem = SemiProjection(
            np.zeros(k), counted, joined.matrix @ state.basis, joined.bound - joined.matrix @ state.x, e
        )
        answer = _trusted(semi_project(problem, u, projector))
        answer = _trusted(completed(problem, answer))
        u = answer.n
        x = state.x + state.basis @ u
        above, found = state.violated(x), _violated(level, x)
        if len(above.bound) or len(found.bound):
            state.add(above)
            rows = stack_constraints([rows, found], len(x))
            continue
        if answer.distance > _DISTANCE * max(1.0, float(np.linalg.norm(answer.p))):
            continue
        load = answer.multipliers
        state.x = x
        state.pin(state.hard.only(load[e : e + h] > _ACTIVE))
        state.hard = state.hard.only(load[e : e + h] <= _ACTIVE)
        reached = float(np.linalg.norm(rows.violations(x)))
        _keep(state, level, rows, np.concatenate([np.ones(e, dtype=bool), load[e + h :] > _ACTIVE]))
        return reached
    raise LevelFailed(SolveStatus.NOT_OPTIMAL)


def _trusted(answer: SemiAnswer | None) -> SemiAnswer:
    """An answer whose feasibility and rough optimality were recomputed.

    Raises:
        LevelFailed: there is none.
    """
    if answer is None:
        raise LevelFailed(SolveStatus.INFEASIBLE)
    if not np.isfinite(answer.gap):
        raise LevelFailed(SolveStatus.NOT_FINITE)
    if answer.violation > _VIOLATED:
        raise LevelFailed(SolveStatus.VIOLATED)
    return answer


def _fit(state: HierarchyState, matrix: Array, measured: Array, projector: Projector) -> float:
    """``min ‖matrix·x − measured‖²``; keeps the product that it reaches. Returns the distance bound."""
    seen = row_space(matrix @ state.basis)
    along, across = state.basis @ seen.inverse, state.basis @ seen.null
    target = seen.image.T @ (measured - matrix @ state.x)
    free = np.zeros(across.shape[1])
    rows = state.hard
    problem = SemiProjection(
        target, rows.matrix @ along, rows.matrix @ across, rows.bound - rows.matrix @ state.x, 0
    )
    weak = WEAK
    for _ in range(_MAX_ROUNDS):
        answer = _trusted(semi_project(problem, free, projector, weak))
        found = state.violated(state.x + along @ answer.p + across @ answer.n)
        if not len(found.bound):
            answer = _trusted(completed(problem, answer))
            found = state.violated(state.x + along @ answer.p + across @ answer.n)
        good = answer.distance <= _DISTANCE * max(1.0, float(np.linalg.norm(answer.p - target)))
        if not len(found.bound) and good:
            break
        known = len(state.hard.bound)
        state.add(found)
        new = LinearConstraints(state.hard.matrix[known:], state.hard.bound[known:], found.labels)
        problem = problem.extended(new.matrix @ along, new.matrix @ across, new.bound - new.matrix @ state.x)
        # From the same centre as long as rows are missing, so that the projector can go on where it stood.
        if not len(found.bound):
            free, weak = answer.n, max(0.1 * weak, _LEAST_WEAK)
    else:
        raise LevelFailed(SolveStatus.NOT_OPTIMAL)
    rows = state.hard
    state.x, state.basis = state.x + along @ answer.p + across @ answer.n, across
    state.pin(rows.only(answer.multipliers > _ACTIVE))
    state.hard = stack_constraints([], len(state.x))
    state.add(rows.only(answer.multipliers <= _ACTIVE))
    return answer.distance


def _nearest(state: HierarchyState, projector: Projector) -> float:
    """``min ‖x‖²`` in what is left; returns the distance bound."""
    target = -state.basis.T @ state.x
    for _ in range(_MAX_ROUNDS):
        matrix = state.hard.matrix @ state.basis
        length = np.linalg.norm(matrix, axis=1)
        kept = length > EMPTY
        rows = LinearConstraints(
            matrix[kept] / length[kept, None],
            (state.hard.bound - state.hard.matrix @ state.x)[kept] / length[kept],
            ("",) * int(kept.sum()),
        )
        answer = projector(target, rows)
        if answer is None:
            raise LevelFailed(SolveStatus.INFEASIBLE)
        if not _finite(answer):
            raise LevelFailed(SolveStatus.NOT_FINITE)
        if rows.violations(answer.z).max(initial=0.0) > _VIOLATED:
            raise LevelFailed(SolveStatus.VIOLATED)
        distance = distance_to_optimum(target, rows, answer)
        if distance > _COARSE_DISTANCE * max(1.0, float(np.linalg.norm(answer.z - target))):
            raise LevelFailed(SolveStatus.NOT_OPTIMAL)
        x = state.x + state.basis @ answer.z
        found = state.violated(x)
        if not len(found.bound):
            state.x = x
            return distance
        state.add(found)
    raise LevelFailed(SolveStatus.CUT_LIMIT)
