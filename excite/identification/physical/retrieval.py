"""Retrieval of physical parameters to global optimality: starts, then bounds (Xu et al. 2020, Table 1)."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, fields

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.physical.certificate import Certificate
from excite.identification.physical.feasible_set import FeasibleSet
from excite.identification.physical.objective import TorqueObjective
from excite.identification.physical.relaxation import Relaxation, Relaxed
from excite.identification.physical.search import LocalOptimum, descend_locally

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

    starts: int = 5
    seed: int = 0
    gap: float = 1e-3
    nodes: int = 200

    def __post_init__(self) -> None:
        """Check every bound.

        Raises:
            InputError: names the setting.
        """
        least = {"starts": 0, "seed": 0, "gap": 0.0, "nodes": 1}
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value < least[item.name]:
                raise InputError(
                    f"is {value!r}",
                    source="settings",
                    field=item.name,
                    remedy=f"choose at least {least[item.name]}",
                )


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
        allowed: the constraints.
        center: ``(size,)`` coordinates that are preferred among equally good ones, the nominal model's.
        settings: effort.

    Raises:
        NoSolutionError: the constraints contradict each other.
    """
    size = max(objective.floor**2, 1e-9 * float(objective.target @ objective.target))
    weight = np.sqrt(_PULL * size) / allowed.scale
    problem = Relaxation(objective, allowed, weight, allowed.nearest(center))
    return _Search(problem, settings).run()


@dataclass(order=True)
class _Node:
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
        bounds, free = self.problem.allowed.bounds, self.problem.allowed.free
        self._relax(bounds.lower[free, 1:4], bounds.upper[free, 1:4], self.problem.objective.floor)
        rng = np.random.default_rng(self.settings.seed)
        for _ in range(self.settings.starts):
            if self.closed:
                break
            self._descend(self._random(rng))
        while self.open and not self.closed and self.relaxations < self.settings.nodes:
            self._branch(heapq.heappop(self.open))
        best, bound = self.best, self.bound
        certificate = Certificate(
            objective=best.objective,
            lower_bound=bound,
            gap=(best.objective - bound) / best.objective if best.objective > 0.0 else 0.0,
            relaxations=self.relaxations,
            optima=tuple(optimum.objective for optimum in self.optima),
        )
        return Retrieval(self.problem.allowed.standard(best.x), certificate)

    @property
    def best(self) -> LocalOptimum:
        return min(self.optima, key=lambda optimum: optimum.objective)

    @property
    def bound(self) -> float:
        """No allowed robot has a smaller objective."""
        if not self.optima:
            return self.open[0].bound if self.open else self.problem.objective.floor
        return min(self.open[0].bound if self.open else np.inf, self.best.objective)

    @property
    def closed(self) -> bool:
        return self.bound >= (1.0 - self.settings.gap) * self.best.objective

    def _relax(self, low: Array, high: Array, parent: float) -> None:
        """Relax on boxes; keep what may hold something better, descend from what looks better."""
        self.relaxations += 1
        relaxed = self.problem.solve(low, high)
        if relaxed is None:
            # Empty boxes or a solver that failed: the parent's bound holds for either.
            relaxed = Relaxed(parent, self.problem.allowed.interior, np.ones_like(self.effect))
        bound = max(relaxed.bound, parent)
        completed = self.problem.completed(relaxed)
        for start in (completed, relaxed.x):
            if start is not None:
                self._consider(start, bound)
        best = self.best.objective
        if bound < best:
            heapq.heappush(self.open, _Node(bound, self.relaxations, low, high, relaxed))

    def _consider(self, start: Array, bound: float) -> None:
        """Take a point that is as good as its bound, descend from one that is better than the best."""
        value = self.problem.objective.value(self.problem.allowed.standard(start))
        if self.optima and value >= self.best.objective:
            return
        if bound >= (1.0 - self.settings.gap) * value:
            self.optima.append(LocalOptimum(start, value, 0))
        else:
            self._descend(start)

    def _descend(self, start: Array) -> None:
        self.optima.append(descend_locally(self.problem, start))

    def _random(self, rng: np.random.Generator) -> Array:
        """``LB + (UB − LB)u`` (step 4 of Table 1), moved to the nearest point that meets eq. (17), (18)."""
        allowed = self.problem.allowed
        span = allowed.bounds.upper - allowed.bounds.lower
        physical = allowed.bounds.lower + span * rng.uniform(size=span.shape)
        share = rng.uniform(size=len(allowed.drive_lower))
        drives = allowed.drive_lower + (allowed.drive_upper - allowed.drive_lower) * share
        return allowed.nearest(allowed.coordinates(physical, drives))

    def _branch(self, node: _Node) -> None:
        """Cut the box whose relaxation is least exact, near where the relaxed centre of mass lies."""
        doubt = np.abs(node.relaxed.excess) * self.effect
        # Second moments xx, xy, yy, xz, yz, zz depend on the box's sides x, y, z.
        sides = np.column_stack(
            [
                doubt[:, [0, 1, 3]].sum(axis=1),
                doubt[:, [1, 2, 4]].sum(axis=1),
                doubt[:, [3, 4, 5]].sum(axis=1),
            ]
        )
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
        for side in (node.low, node.high):
            changed = side.copy()
            changed[segment, axis] = cut
            pair = (node.low, changed) if side is node.high else (changed, node.high)
            self._relax(*pair, node.bound)
