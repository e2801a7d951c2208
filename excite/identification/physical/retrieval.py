"""Retrieval of physical parameters to global optimality: starts, then bounds (Xu et al. 2020, Table 1)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.display import percent
from excite.identification.inertia import COLUMNS, ROWS, STEINER
from excite.identification.physical.cone_program import ConeProgram, solve_cone_program
from excite.identification.physical.feasible_set import FeasibleSet, TorqueObjective
from excite.results import Stated, Unbounded
from excite.rows.settings import check_settings, number

# What is proven about a retrieval's objective.


@dataclass(frozen=True)
class Certificate(Stated):
    """How far an objective can be from the best one that the constraints allow.

    Attributes:
        objective: ``f`` of eq. (15) of Xu et al. 2020 at the answer [N·m, or the rows' unit].
        lower_bound: no parameters within the constraints have a smaller one, by convex relaxation.
        gap: ``(objective − lower_bound) / objective``.
        relaxations: convex relaxations solved to prove it.
        optima: objective of each local optimum found, in the order of the starts: the relaxation's own, then
            random ones.
    """

    objective: Unbounded
    lower_bound: Unbounded
    gap: Unbounded
    relaxations: int
    optima: tuple[Unbounded, ...]

    def summary(self) -> str:
        """One line."""
        return (
            f"objective {self.objective:.4g}, proven not to go below {self.lower_bound:.4g} "
            f"(gap {percent(100.0 * self.gap)}, {self.relaxations} relaxations, {len(self.optima)} starts)"
        )


# A convex relaxation of the retrieval: its minimum bounds the objective of every allowed robot from below.
#
# The products ``H = hhᵀ/m`` become variables of their own with ``[[H, h], [hᵀ, m]] ⪰ 0`` and with the four
# products of the sides of each centre of mass's box (McCormick 1976, multiplied by the mass), for example
# ``(h_p − l_p m)(u_q m − h_q)/m ≥ 0``. The smaller the boxes, the tighter the bound.


@dataclass(frozen=True, eq=False)
class Relaxed:
    """What the relaxation says of robots whose centres of mass lie in given boxes.

    Attributes:
        bound: no such robot has an objective below this [N·m], recomputed from the multipliers.
        x: ``(size,)`` coordinates in the feasible set.
        excess: ``H − hhᵀ/m`` of each free segment, ``(n_free, 6)`` [kg·m²]: 0 where the relaxation is exact.
    """

    bound: float
    x: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The relaxation of one problem.

    Attributes:
        objective: what is to be small.
        allowed: the set of allowed parameters.
        weight: of the pull towards ``center``, which picks one of equally good robots, ``(size,)``.
        center: ``(size,)``.
    """

    objective: TorqueObjective
    allowed: FeasibleSet
    weight: Array
    center: Array

    def solve(self, low: Array, high: Array) -> Relaxed | None:
        """Relax with boxes of the centres of mass ``(n_free, 3)`` [m]; None where nothing lies in them."""
        allowed, n_moments = self.allowed, 6 * len(self.allowed.free)
        lifted = self._lifted_scale()
        rows = np.pad(np.vstack([allowed.rows, allowed.box_rows(low, high)]), ((0, 0), (0, n_moments)))
        rows = np.vstack([rows, self._product_rows(low, high)])
        density = np.pad(allowed.density, ((0, 0), (0, 0), (0, n_moments)))
        # [[H, h], [hᵀ, m]] of each free segment, scaled to its size, (n_free, 10, n).
        mass, first = self.allowed.scale[: self.allowed.n_body].reshape(-1, 10)[:, :2].T[:, :, None]
        local = np.zeros((len(mass), 10, 16))
        local[:, range(6), range(10, 16)] = mass / first**2
        local[:, (6, 7, 8), (1, 2, 3)] = 1.0 / first
        local[:, 9, :1] = 1.0 / mass
        program = ConeProgram(
            matrix=self.objective.factor @ allowed.lift,
            target=self.objective.target - self.objective.factor @ allowed.offset,
            rows=rows,
            bound=np.pad(allowed.bound, (0, len(rows) - len(allowed.bound))),
            cones=(self._on_segments(local), *((density,) if len(density) else ())),
            weight=np.pad(self.weight, (0, n_moments)),
            center=np.pad(self.center, (0, n_moments)),
            scale=lifted,
        )
        answer = solve_cone_program(program)
        if answer is None:
            return None
        x, moments = answer.z[: allowed.size], answer.z[allowed.size :]
        inside = allowed.inside(x)
        return Relaxed(
            bound=self._bound_below(program, answer.z, answer.linear, answer.cones),
            x=inside,
            excess=(moments - allowed.moments(inside)).reshape(-1, 6),
        )

    def _bound_below(self, program: ConeProgram, z: Array, linear: Array, cones: tuple[Array, ...]) -> float:
        """Lower bound from multipliers, whatever solver they came from.

        For every ``z`` that is allowed, ``½‖r‖² ≥ yᵀr − ½‖y‖²`` and the multipliers' terms are not negative:
        ``½‖r‖² ≥ −½‖y‖² − yᵀd + λᵀb + wᵀz`` with ``w`` what is left of stationarity, whose least value over
        the box around all allowed ``z`` is taken (Jansson 2004).
        """
        y = program.matrix @ z - program.target
        w = program.matrix.T @ y - program.rows.T @ linear
        for cone, dual in zip(program.cones, cones, strict=True):
            w -= np.einsum("ktn,kt->n", cone, dual)
        low, high = self._find_corners()
        least = float(np.minimum(w * low, w * high).sum())
        half = float(linear @ program.bound - y @ program.target - 0.5 * y @ y) + least
        return float(np.sqrt(max(2.0 * half, 0.0) + self.objective.floor**2))

    def _lifted_scale(self) -> Array:
        inertia = self.allowed.scale[4 : self.allowed.n_body : 10]
        return np.concatenate([self.allowed.scale, np.repeat(inertia, 6)])

    def _find_corners(self) -> tuple[Array, Array]:
        """Lower and upper corner of a box around all allowed ``(x, H)``."""
        allowed = self.allowed
        low, high = allowed.bounds.lower[allowed.free], allowed.bounds.upper[allowed.free]
        first = high[:, :1] * allowed.reach
        moments = (high[:, :1] * allowed.reach[:, ROWS] * allowed.reach[:, COLUMNS]).ravel()
        lower = np.hstack([low[:, :1], -first, low[:, 4:]]).ravel()
        upper = np.hstack([high[:, :1], first, high[:, 4:]]).ravel()
        return (
            np.concatenate([lower, allowed.drive_lower, -moments]),
            np.concatenate([upper, allowed.drive_upper, moments]),
        )

    def _on_segments(self, local: Array) -> Array:
        """Rows ``(n_free, k, 16)`` on ten coordinates and six moments of each segment made to act on all."""
        allowed, rows = self.allowed, np.zeros((*local.shape[:2], len(self._lifted_scale())))
        for place, (row, own) in enumerate(zip(rows, local, strict=True)):
            row[:, 10 * place : 10 * place + 10] = own[:, :10]
            row[:, allowed.size + 6 * place : allowed.size + 6 * place + 6] = own[:, 10:]
        return rows

    def _product_rows(self, low: Array, high: Array) -> Array:
        """Products of the sides of the boxes, rows ``≥ 0`` of unit length in scaled units."""
        found = []
        for k, (p, q) in enumerate(zip(ROWS, COLUMNS, strict=True)):
            # ±(h_p − s m)(h_q − t m)/m ≥ 0
            sides = [(1.0, low, low), (1.0, high, high), (-1.0, low, high), (-1.0, high, low)]
            for sign, near, far in sides[: 3 if p == q else 4]:
                s, t, row = near[:, p], far[:, q], np.zeros((len(low), 16))
                row[:, 10 + k], row[:, 0] = sign, sign * s * t
                row[:, 1 + p] -= sign * t
                row[:, 1 + q] -= sign * s
                found.append(row)
        rows = self._on_segments(np.stack(found, axis=1)).reshape(-1, len(self._lifted_scale()))
        return np.asarray(rows / np.linalg.norm(rows * self._lifted_scale(), axis=1, keepdims=True))

    def completed(self, relaxed: Relaxed) -> Array | None:
        """The relaxed robot with the excess second moments made part of its bodies, ``(size,)``, None if not allowed.

        It then has the relaxation's objective: nothing is better.
        """
        x = relaxed.x.copy()
        body = x[: self.allowed.n_body].reshape(-1, 10)
        body[:, 4:] += relaxed.excess @ STEINER.T
        return self.allowed.inside(x) if self.allowed.slack(x) > -1e-7 else None


# Pull to the center that picks one of many equally good robots, as share of the unexplained part of f².
_PULL = 1e-6
# Boxes of the centres of mass are cut no smaller than this [m].
_SMALLEST_SIDE = 1e-5


@dataclass(frozen=True)
class RetrievalSettings:
    """Effort of a retrieval.

    Attributes:
        starts: random starts, κ of Table 1; left out once the gap is closed.
        seed: of the starts.
        gap: relative gap between objective and lower bound at which the search ends.
        nodes: most relaxations that are solved to close the gap; 1 is the relaxation of the whole set alone.
    """

    starts: int = number(5, "1", 0, 1e9, "random starts")
    seed: int = number(0, "1", 0, 2**63, "of the starts")
    gap: float = number(1e-3, "1", 0.0, 1.0, "relative gap at which the search ends")
    nodes: int = number(200, "1", 1, 1e9, "most relaxations")

    def __post_init__(self) -> None:
        """Check every bound; raises InputError, which names the setting."""
        check_settings(self)


@dataclass(frozen=True, eq=False)
class Retrieval:
    """Retrieved parameters.

    Attributes:
        parameters: standard parameters and drives, ``(n_params,)`` [SI].
        certificate: how good they are.
    """

    parameters: Array
    certificate: Certificate


def retrieve_parameters(
    objective: TorqueObjective, allowed: FeasibleSet, center: Array, settings: RetrievalSettings
) -> Retrieval:
    """Minimise eq. (15) under eq. (16) to (18) of Xu et al. 2020.

    Starts from the convex relaxation and from random points, descends from each, and divides the boxes of
    the centres of mass until the relaxations prove that nothing better is left (branch and bound).

    Args:
        objective: what is to be small.
        center: ``(size,)`` coordinates that are preferred among equally good ones, the nominal model's.
        settings: effort.

    Raises:
        NoSolutionError: the constraints contradict each other.
    """
    size = max(objective.floor**2, 1e-9 * float(objective.target @ objective.target))
    weight = np.sqrt(_PULL * size) / allowed.scale
    problem = Relaxation(objective, allowed, weight, allowed.nearest(center))
    return _Search(problem, settings).run()


class _Node(NamedTuple):
    """Boxes still to be searched; ordered by bound."""

    bound: float
    number: int
    low: Array
    high: Array
    relaxed: Relaxed


class _Search:
    """Best answer so far, and what is left to be searched."""

    def __init__(self, problem: Relaxation, settings: RetrievalSettings):
        self.problem, self.settings = problem, settings
        self.optima: list[LocalOptimum] = []
        self.relaxations = 0
        self.open: list[_Node] = []
        lifted = problem.objective.factor @ problem.allowed.lift
        # What a unit of each second moment does to the torques: how much an inexact one matters.
        self.effect = np.linalg.norm(lifted[:, problem.allowed.size :], axis=0).reshape(-1, 6)

    def run(self) -> Retrieval:
        """Starts, then branch and bound."""
        allowed, rng = self.problem.allowed, np.random.default_rng(self.settings.seed)
        ends = (allowed.bounds.lower, allowed.bounds.upper)
        boxes = [end[allowed.free, 1:4] for end in ends]
        self._relax_boxes(boxes[0], boxes[1], self.problem.objective.floor)
        for _ in range(self.settings.starts):
            if self.closed:
                break
            # ``LB + (UB − LB)u`` (step 4 of Table 1), moved to the nearest point that meets eq. (17), (18).
            physical = ends[0] + (ends[1] - ends[0]) * rng.uniform(size=ends[0].shape)
            share = rng.uniform(size=len(allowed.drive_lower))
            drives = allowed.drive_lower + (allowed.drive_upper - allowed.drive_lower) * share
            start = allowed.nearest(allowed.coordinates(physical, drives))
            self.optima.append(descend_locally(self.problem, start))
        while self.open and not self.closed and self.relaxations < self.settings.nodes:
            self._branch_node(heapq.heappop(self.open))
        best, bound = self.best, self.bound
        certificate = Certificate(
            objective=best.objective,
            lower_bound=bound,
            gap=(best.objective - bound) / best.objective if best.objective > 0.0 else 0.0,
            relaxations=self.relaxations,
            optima=tuple(optimum.objective for optimum in self.optima),
        )
        return Retrieval(allowed.standard(best.x), certificate)

    @property
    def best(self) -> LocalOptimum:
        return min(self.optima, key=lambda optimum: optimum.objective)

    @property
    def bound(self) -> float:
        """No allowed robot has a smaller objective."""
        return min(self.open[0].bound if self.open else np.inf, self.best.objective)

    @property
    def closed(self) -> bool:
        return self.bound >= (1.0 - self.settings.gap) * self.best.objective

    def _relax_boxes(self, low: Array, high: Array, parent: float) -> None:
        """Relax on boxes; keep what may hold something better, descend from what looks better."""
        self.relaxations += 1
        # Empty boxes or a solver that failed: the parent's bound holds for either.
        failed = Relaxed(parent, self.problem.allowed.interior, np.ones_like(self.effect))
        relaxed = self.problem.solve(low, high) or failed
        bound = max(relaxed.bound, parent)
        for start in (self.problem.completed(relaxed), relaxed.x):
            if start is None:
                continue
            value = self.problem.objective.value(self.problem.allowed.standard(start))
            if self.optima and value >= self.best.objective:
                continue
            # A point that is as good as its bound is taken as it is.
            exact = bound >= (1.0 - self.settings.gap) * value
            found = LocalOptimum(start, value) if exact else descend_locally(self.problem, start)
            self.optima.append(found)
        if bound < self.best.objective:
            heapq.heappush(self.open, _Node(bound, self.relaxations, low, high, relaxed))

    def _branch_node(self, node: _Node) -> None:
        """Cut the box whose relaxation is least exact, near where the relaxed centre of mass lies."""
        doubt = np.abs(node.relaxed.excess) * self.effect
        # Second moments xx, xy, yy, xz, yz, zz depend on the box's sides x, y, z.
        sides = np.column_stack([doubt[:, (ROWS == k) | (COLUMNS == k)].sum(axis=1) for k in range(3)])
        sides[node.high - node.low < _SMALLEST_SIDE] = -1.0
        segment, axis = np.unravel_index(int(np.argmax(sides)), sides.shape)
        if sides[segment, axis] < 0.0:
            heapq.heappush(self.open, node)
            self.relaxations = self.settings.nodes
            return
        low, high = node.low[segment, axis], node.high[segment, axis]
        mass, *first = node.relaxed.x[10 * segment : 10 * segment + 4]
        middle = 0.25 * (low + high) + 0.5 * first[axis] / mass
        cut = float(np.clip(middle, low + 0.2 * (high - low), high - 0.2 * (high - low)))
        lower, upper = node.low.copy(), node.high.copy()
        lower[segment, axis] = upper[segment, axis] = cut
        self._relax_boxes(lower, node.high, node.bound)
        self._relax_boxes(node.low, upper, node.bound)


# Descent to a local optimum of the retrieval: Gauss-Newton steps over the feasible set (Levenberg 1944).

_ITERATIONS = 80
_GAIN = 1e-7
_LARGEST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """Where a descent ended.

    Attributes:
        x: ``(size,)`` coordinates in the feasible set.
        objective: ``f`` of eq. (15) there [N·m].
    """

    x: Array
    objective: float


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

    def torque_residual(x: Array) -> Array:
        return np.asarray(lifted @ np.concatenate([x, allowed.moments(x)]) - target)

    def half_cost(x: Array) -> float:
        rest, pull = torque_residual(x), problem.weight * (x - problem.center)
        return 0.5 * float(rest @ rest + pull @ pull)

    x, damping = start, 1e-2
    best = half_cost(x)
    # What matters is the objective with its floor: changes far below it are of no interest.
    small = _GAIN * max(0.5 * objective.floor**2, 1e-9 * 0.5 * float(target @ target))
    for _ in range(_ITERATIONS):
        # Derivative of (x, hhᵀ/m) by x, (size + 6·n_free, size).
        body = x[: allowed.n_body].reshape(-1, 10)
        c, local = body[:, 1:4] / body[:, :1], np.zeros((len(body), 6, 10))
        for k, (p, q) in enumerate(zip(ROWS, COLUMNS, strict=True)):
            local[:, k, 0] = -c[:, p] * c[:, q]
            local[:, k, 1 + p] += c[:, q]
            local[:, k, 1 + q] += c[:, p]
        rest, slope = torque_residual(x), lifted @ np.vstack([np.eye(allowed.size), allowed.on_bodies(local)])
        gained = 0.0
        while damping < _LARGEST_DAMPING:
            pull = np.sqrt(problem.weight**2 + damping / allowed.scale**2)
            centre = (problem.weight**2 * problem.center + damping / allowed.scale**2 * x) / pull**2
            trial = allowed.step(slope, slope @ x - rest, pull, centre)
            step, offset = trial - x, problem.weight * (trial - problem.center)
            ahead = rest + slope @ step
            predicted = best - 0.5 * float(ahead @ ahead + offset @ offset)
            gained = best - half_cost(trial)
            if predicted < small or gained > 0.1 * predicted:
                break
            damping *= 4.0
        if gained > 0.0:
            x, best = trial, best - gained
        if predicted < small or gained < small:
            break
        if gained > 0.7 * predicted:
            damping = max(damping / 4.0, 1e-9)
    return LocalOptimum(x, objective.value(allowed.standard(x)))
