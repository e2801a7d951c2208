"""What a check is: the abstract class that all checks of a motion derive from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array, Flags
from excite.robot.prismatic import sliding_joints
from excite.robot.robot import Robot
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Margins, Nearest, Violation, unit_of


@dataclass(frozen=True)
class CheckResult:
    """What one check found.

    Attributes:
        margin: smallest margin over the motion, in the unit of the check's ``margin_field``; None where it
            could not be computed, or the check has no margin.
        violations: at most one per kind and place, at its first time.
        applicable: False where the check means nothing for this robot.
        readable: False where the motion is so broken that nothing else can be computed from it.
        nearest: of a margin of joints, the nearest to its limit in each unit.
    """

    margin: float | None = None
    violations: tuple[Violation, ...] = ()
    applicable: bool = True
    readable: bool = True
    nearest: tuple[Nearest, ...] = ()


class Check(ABC):
    """A judgement on a motion. It repairs nothing, and what it cannot compute it does not let pass.

    The package's own are functions, a row each of :data:`excite.safety.check.CHECKS`; others derive from this.

    Attributes:
        name: registry name.
        margin_field: field of :class:`~excite.safety.verdict.Margins` that it fills, or None.
    """

    name: ClassVar[str]
    margin_field: ClassVar[str | None] = None

    @abstractmethod
    def judge(self, sweep: Sweep) -> CheckResult:
        """Judge a motion; quantities that several checks need are computed once, in the sweep."""

    def mistake_in(self, method: str, result: CheckResult, *_: object) -> str:
        """What is wrong with what a derived class's method returns; empty for nothing."""
        if method != "judge" or result.margin is None:
            return ""
        if self.margin_field is not None and self.margin_field not in Margins.__dataclass_fields__:
            known = ", ".join(Margins.__dataclass_fields__)
            return f"fills the margin {self.margin_field!r} where one of {known} is expected"
        return (
            ""
            if np.isfinite(result.margin)
            else f"has the margin {result.margin} where a finite one is expected"
        )


def first_violations(
    kind: str, names: tuple[str, ...], time: Array, values: Array, limits: Array, bad: Flags
) -> tuple[Violation, ...]:
    """One violation per column at its first bad row.

    Args:
        kind: kind of all of them.
        names: place of each column.
        time: ``(n,)`` [s].
        values: ``(n, m)``.
        limits: ``(n, m)`` or ``(m,)``, what the values must not pass.
        bad: ``(n, m)``.

    Returns:
        The violations, in the order of columns.
    """
    limits = np.broadcast_to(limits, values.shape)
    found = []
    for column in np.flatnonzero(bad.any(axis=0)):
        row = int(np.argmax(bad[:, column]))
        value = float(values[row, column])
        limit = float(limits[row, column])
        found.append(
            Violation(kind, float(time[row]), names[column], value if np.isfinite(value) else None, limit)
        )
    return tuple(found)


def first_violation(
    kind: str, where: str, time: Array, values: Array, limit: float, bad: Flags
) -> tuple[Violation, ...]:
    """The violation at the first bad of times, ``(n,)`` each, if any is; arguments as of :func:`first_violations`."""
    return first_violations(kind, (where,), time, values[:, None], np.array([limit]), bad[:, None])


def nearest_joints(kind: str, robot: Robot, room: Array) -> tuple[Nearest, ...]:
    """The joints that come nearest to their limits, those that slide and those that turn apart.

    Args:
        kind: what is limited, such as ``joint_velocity``.
        robot: whose joints.
        room: ``(n_joints,)`` what is left to the limits, in the joints' units; what is not finite does not count.

    Returns:
        One a unit, the smallest first.
    """
    sliding, found = sliding_joints(robot), dict[str, Nearest]()
    for name, value in zip(robot.joint_names, room, strict=True):
        unit = unit_of(kind, name, sliding)
        if np.isfinite(value) and (unit not in found or value < found[unit].value):
            found[unit] = Nearest(name, float(value), unit)
    return tuple(sorted(found.values(), key=lambda one: one.value))
