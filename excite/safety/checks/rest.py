"""Motions start and end at rest, or where another one ends and starts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.sampling import coordinate_names, velocity_tolerance
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# How far apart the ends of two motions of a chain may be [rad or m]: what single precision leaves of a turn is 2e-7.
_APART = 1e-5


class RestCheck(Check):
    """Velocities of joints and base at the first and the last sample.

    A controller that is handed a motion starts it from a standing robot and stops where it ends. What counts as
    standing is what :class:`~excite.safety.checks.sampling.SamplingCheck` lets velocities be off by: half a percent of
    a joint's limit. Motions that start and end at rest, sampled at 50 to 1000 Hz and stripped of all but positions,
    use up to 14 % of that. A motion whose file names the one before or after it may start or end moving, if that one is
    among those that are judged together, names it in turn, and ends or starts in the same posture with the same
    velocities and contacts; and if the chain comes from rest and to rest at its ends.
    """

    name: ClassVar[str] = "rest"

    def judge(self, sweep: Sweep) -> CheckResult:
        robot, motion = sweep.robot, sweep.motion
        names = coordinate_names(robot)
        found: list[Violation] = []
        for row, kind in ((0, "starts_moving"), (-1, "ends_moving")):
            neighbour = _neighbour_name(motion, row)
            speed, limit = np.abs(motion.v[row]), velocity_tolerance(robot)
            if neighbour:
                apart = _open_end(motion, row, sweep.neighbours) or _describe_misfit(
                    robot, motion, row, sweep.neighbours[neighbour]
                )
                if apart is not None:
                    time = float(motion.time[row])
                    found.append(Violation("chain_does_not_fit", time, f"{neighbour} ({apart})", None, None))
                continue
            for column in np.flatnonzero(~(speed <= limit)):
                value = float(speed[column])
                found.append(
                    Violation(kind, float(motion.time[row]), names[column], value, float(limit[column]))
                )
        return CheckResult(violations=tuple(found))


def _open_end(motion: Motion, row: int, others: Mapping[str, Motion]) -> str | None:
    """What keeps a chain from coming from rest (row 0) or to rest (row -1): a motion that is not there, or a ring."""
    seen, name = {motion.name}, _neighbour_name(motion, row)
    while name:
        if name not in others:
            return "not among the motions checked"
        if name in seen:
            return "leads back to itself and never rests"
        seen.add(name)
        name = _neighbour_name(others[name], row)
    return None


def _neighbour_name(motion: Motion, row: int) -> str:
    return motion.metadata.previous if row == 0 else motion.metadata.following


def _describe_misfit(robot: Robot, motion: Motion, row: int, neighbour: Motion) -> str | None:
    """What keeps a motion's first (row 0) or last (row -1) sample from being where its neighbour ends or starts."""
    if neighbour.joint_names != motion.joint_names:
        return "has other joints"
    back = neighbour.metadata.following if row == 0 else neighbour.metadata.previous
    if back != motion.name:
        return "does not name it"
    other = -1 if row == 0 else 0
    if not _is_near(motion.q[row], neighbour.q[other], np.full(motion.q.shape[1], _APART)):
        return "is in another posture there"
    if not _is_near(motion.v[row], neighbour.v[other], velocity_tolerance(robot)):
        return "moves otherwise there"
    for foot, flags in motion.contacts.items():
        flag = neighbour.contacts.get(foot)
        if flag is None or flag[other] != flags[row]:
            return "stands on other feet there"
    return None


def _is_near(a: Array, b: Array, tolerance: Array) -> bool:
    return a.shape == b.shape and bool((np.abs(a - b) <= tolerance).all())
