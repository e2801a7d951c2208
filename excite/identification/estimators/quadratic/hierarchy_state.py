"""Levels of a hierarchy, and the space that those already met have left."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.base import SolveStatus
from excite.identification.orthogonal import row_space

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
