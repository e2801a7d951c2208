"""Lexicographic least squares: levels of constraints, then a fit, then the nearest point (Escande et al. 2014).

A level's constraints are met with the least sum of squared violations that the levels above allow, and what
it has reached is then kept exactly: violations at an optimum are unique, so each violated row becomes an
equality, and so does each row that a positive multiplier shows to be active at every optimum. All that is
left is a smaller space and rows that hold. Every answer of a solver is recomputed before it is used."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from excite.arrays import Array, Flags
from excite.identification.constraints.linear import LinearConstraints, stack_constraints, unit_rows
from excite.identification.estimators.estimator import DISTANCE_TOLERANCE, FEASIBLE, SolveStatus
from excite.identification.estimators.projection import ProjectionAnswer, Projector, distance_to_optimum
from excite.identification.regression import row_space

Mask = Flags

# Rows have unit length on the scaled parameters: a violation is a share of a parameter's spread.
_VIOLATED = 1e-7
_ACTIVE = 1e-9
_MAX_ROUNDS = 60
# Accepted distance to a level's optimum, as a share of the distance that the constraints enforce.
_DISTANCE = 1e-5


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
            slacks.append(_meet_level(state, level, projector))
        fit_distance = _fit_rows(state, matrix, measured, projector)
        distance = _find_nearest(state, projector)
    except LevelFailed as failure:
        status = failure.status
    return HierarchyAnswer(state.x, status, tuple(slacks), fit_distance, distance)


def _meet_level(state: HierarchyState, level: Level, projector: Projector) -> float:
    """Meet a level as well as the levels above allow; returns the norm of what is violated."""
    rows, n = level.constraints, len(state.x)
    for _ in range(_MAX_ROUNDS):
        both = stack_constraints([state.hard, rows], n)
        matrix = both.matrix @ state.basis
        bound = both.bound - both.matrix @ state.x
        length = np.linalg.norm(matrix, axis=1)
        if np.abs(bound[length <= EMPTY]).max(initial=0.0) > FEASIBLE and both.n_equal:
            break
        listed = unit_rows(matrix, bound, n_equal=both.n_equal, least=EMPTY)
        answer = projector(np.zeros(matrix.shape[1]), listed)
        if answer is None or not _is_finite(answer):
            break
        x = state.x + state.basis @ answer.z
        if both.violations(x).max(initial=0.0) > FEASIBLE:
            break
        above, found = state.violated(x), _violated_rows(level, x)
        if not len(above.bound) and not len(found.bound):
            state.x = x
            _keep_level(state, level, rows, np.arange(len(rows.bound)) < rows.n_equal)
            return 0.0
        state.add(above)
        rows = stack_constraints([rows, found], n)
    return _least_violation(state, level, rows, projector)


def _violated_rows(level: Level, x: Array) -> LinearConstraints:
    return stack_constraints([], len(x)) if level.family is None else level.family.violated(x)


def _is_finite(answer: ProjectionAnswer) -> bool:
    return bool(np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all())


def _keep_level(state: HierarchyState, level: Level, rows: LinearConstraints, pinned: Mask) -> None:
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
        answer = semi_project(problem, u, projector)
        u = answer.n
        x = state.x + state.basis @ u
        above, found = state.violated(x), _violated_rows(level, x)
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
        _keep_level(state, level, rows, np.concatenate([np.ones(e, dtype=bool), load[e + h :] > _ACTIVE]))
        return reached
    raise LevelFailed(SolveStatus.NOT_OPTIMAL)


def _fit_rows(state: HierarchyState, matrix: Array, measured: Array, projector: Projector) -> float:
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
        answer = semi_project(problem, free, projector, weak)
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


def _find_nearest(state: HierarchyState, projector: Projector) -> float:
    """``min ‖x‖²`` in what is left; returns the distance bound."""
    target = -state.basis.T @ state.x
    for _ in range(_MAX_ROUNDS):
        bound = state.hard.bound - state.hard.matrix @ state.x
        rows = unit_rows(state.hard.matrix @ state.basis, bound, least=EMPTY)
        answer = projector(target, rows)
        if answer is None:
            raise LevelFailed(SolveStatus.INFEASIBLE)
        if not _is_finite(answer):
            raise LevelFailed(SolveStatus.NOT_FINITE)
        if rows.violations(answer.z).max(initial=0.0) > _VIOLATED:
            raise LevelFailed(SolveStatus.VIOLATED)
        distance = distance_to_optimum(target, rows, answer)
        if distance > DISTANCE_TOLERANCE * max(1.0, float(np.linalg.norm(answer.z - target))):
            raise LevelFailed(SolveStatus.NOT_OPTIMAL)
        x = state.x + state.basis @ answer.z
        found = state.violated(x)
        if not len(found.bound):
            state.x = x
            return distance
        state.add(found)
    raise LevelFailed(SolveStatus.CUT_LIMIT)


# Levels of a hierarchy, and the space that those already met have left.

# Length below which what is left of a row, or a direction, counts as nothing.
EMPTY = 1e-9


class RowFamily(Protocol):
    """Rows of a level of which there are too many to list."""

    def violated(self, x: Array) -> LinearConstraints:
        """Some of the rows that ``x`` violates, of unit length; none when all hold."""


@dataclass(frozen=True, eq=False)
class Level:
    """Constraints of equal rank.

    Attributes:
        name: what it is about.
        constraints: rows on the scaled parameters, of unit length.
        family: further rows, None for none.
    """

    name: str
    constraints: LinearConstraints
    family: RowFamily | None = None


@dataclass(frozen=True, eq=False)
class HierarchyAnswer:
    """The lexicographic optimum, or the best point before something failed.

    Attributes:
        x: ``(n,)``.
        status: how it ended.
        slacks: root of the sum of squared violations at each constraint level's optimum.
        fit_distance: bound on the distance to the fit level's optimum, in standard deviations of the noise.
        distance: the same for the last level, in spreads.
    """

    x: Array
    status: SolveStatus
    slacks: tuple[float, ...]
    fit_distance: float
    distance: float


class LevelFailed(Exception):
    """A step found no answer or one that its recomputation refuses; carries the status."""

    def __init__(self, status: SolveStatus):
        self.status = status
        super().__init__(status.name)


@dataclass(eq=False)
class HierarchyState:
    """Where the hierarchy stands: ``x + basis · u`` keeps the equalities that levels have reached.

    Attributes:
        x: present point.
        basis: orthonormal, ``(n, m)``.
        hard: inequalities that hold and must go on holding.
        families: further rows of the levels that have been met.
    """

    x: Array
    basis: Array
    hard: LinearConstraints
    families: list[RowFamily] = field(default_factory=list)

    def violated(self, x: Array) -> LinearConstraints:
        """Rows of the families that ``x`` violates."""
        return stack_constraints([family.violated(x) for family in self.families], len(x))

    def add(self, rows: LinearConstraints) -> None:
        """More inequalities; those that the present point misses by rounding give way to it."""
        eased = LinearConstraints(rows.matrix, np.minimum(rows.bound, rows.matrix @ self.x), rows.labels)
        self.hard = stack_constraints([self.hard, eased], len(self.x))

    def pin(self, rows: LinearConstraints) -> None:
        """Keep the present value of rows."""
        if len(rows.bound):
            self.basis = self.basis @ row_space(rows.matrix @ self.basis, EMPTY).null


# Nearest points where some coordinates do not count: ``min ½‖p − t‖²`` over ``(p, n)`` with linear rows.
#
# The coordinates ``n`` make the problem singular. A proximal term on them gives a projection; from its answer the next
# one goes on, until the gap recomputed without the term is small (Rockafellar 1976). Of 600 random hierarchies with
# condition numbers up to 1e7 these weights solve all; ten times smaller ones leave rounding, larger ones take rounds.
WEAK, _LEAST_WEAK = 1e-6, 1e-12


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


@dataclass(frozen=True, eq=False)
class SemiAnswer:
    """A point and multipliers, with what they are worth.

    Attributes:
        p: ``(k,)``.
        n: ``(j,)``.
        multipliers: ``(m,)``.
        distance: bound on the distance of ``p`` from the optimum, with ``n`` no farther from it than it is long.
    """

    p: Array
    n: Array
    multipliers: Array
    distance: float


def semi_project(
    problem: SemiProjection, start: Array, projector: Projector, weak: float = WEAK
) -> SemiAnswer:
    """One proximal step from ``start``, its feasibility and gap recomputed.

    Args:
        start: ``(j,)`` where the proximal term is centred.
        projector: finds nearest points; not trusted.
        weak: weight of the proximal term.

    Raises:
        LevelFailed: there is no answer, or one that breaks a row.
    """
    k, root = len(problem.target), np.sqrt(weak)
    rows = np.hstack([problem.counted, problem.free / root])
    length, size = (
        np.linalg.norm(rows, axis=1),
        np.hypot(*(np.linalg.norm(part, axis=1) for part in (problem.counted, problem.free))),
    )
    kept = length > EMPTY
    listed = unit_rows(rows, problem.bound - problem.free @ start, n_equal=problem.n_equal, least=EMPTY)
    answer = projector(np.concatenate([problem.target, np.zeros(len(start))]), listed)
    if answer is None:
        raise LevelFailed(SolveStatus.INFEASIBLE)
    p, n, multipliers = answer.z[:k], start + answer.z[k:] / root, np.zeros(len(kept))
    multipliers[kept] = answer.multipliers / length[kept]
    slack, sign = problem.counted @ p + problem.free @ n - problem.bound, multipliers.copy()
    below = np.maximum(-slack, 0.0)
    below[: problem.n_equal] = np.abs(slack[: problem.n_equal])
    sign[problem.n_equal :] = np.maximum(sign[problem.n_equal :], 0.0)
    pull = p - problem.target - problem.counted.T @ sign
    drift = float(np.linalg.norm(problem.free.T @ sign)) * (1.0 + float(np.linalg.norm(n)))
    gap = 0.5 * float(pull @ pull) + float(np.abs(sign * slack).sum()) + drift
    if not np.isfinite(gap):
        raise LevelFailed(SolveStatus.NOT_FINITE)
    if (below / np.maximum(size, EMPTY)).max(initial=0.0) > _VIOLATED:
        raise LevelFailed(SolveStatus.VIOLATED)
    return SemiAnswer(p, n, multipliers, float(np.sqrt(2.0 * gap)))
