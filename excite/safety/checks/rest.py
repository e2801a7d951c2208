"""Motions start and end at rest, or where another one ends and starts."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.motion.motion import Motion
from excite.robot.robot import Array, Robot
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
    velocities and contacts.
    """

    name: ClassVar[str] = "rest"

    def judge(self, sweep: Sweep) -> CheckResult:
        return CheckResult(violations=_end(sweep, 0, "starts_moving") + _end(sweep, -1, "ends_moving"))


def _end(sweep: Sweep, row: int, kind: str) -> tuple[Violation, ...]:
    """What is wrong with a motion's start (row 0) or end (row -1)."""
    robot, motion = sweep.robot, sweep.motion
    time, names = float(motion.time[row]), coordinate_names(robot)
    neighbour = _next(motion, row)
    if neighbour:
        apart = _misfit(robot, motion, row, sweep.neighbours.get(neighbour)) or _circle(sweep, row)
        return (
            ()
            if apart is None
            else (Violation("chain_does_not_fit", time, f"{neighbour} ({apart})", None, None),)
        )
    speed, limit = np.abs(motion.v[row]), velocity_tolerance(robot)
    return tuple(
        Violation(kind, time, names[column], float(speed[column]), float(limit[column]))
        for column in np.flatnonzero(~(speed <= limit))
    )


def _next(motion: Motion, row: int) -> str:
    """Name of the motion that a motion goes on from (row 0), or that goes on from it (row -1)."""
    return motion.metadata.previous if row == 0 else motion.metadata.following


def _circle(sweep: Sweep, row: int) -> str | None:
    """Whether those before (row 0) or after a motion lead back to it: a chain that nowhere is at rest."""
    seen, motion = {sweep.motion.name}, sweep.motion
    while True:
        name = _next(motion, row)
        if not name or name not in sweep.neighbours:
            # Whether the chain fits beyond its neighbours is judged with those.
            return None
        if name in seen:
            return "leads back to it, and nowhere to rest"
        seen.add(name)
        motion = sweep.neighbours[name]


def _misfit(robot: Robot, motion: Motion, row: int, neighbour: Motion | None) -> str | None:
    """What keeps a motion's first (row 0) or last (row -1) sample from being where its neighbour ends or starts."""
    if neighbour is None or neighbour.joint_names != motion.joint_names:
        return "not among the motions checked"
    back = neighbour.metadata.following if row == 0 else neighbour.metadata.previous
    if back != motion.name:
        return "does not name it"
    other = -1 if row == 0 else 0
    if not _near(motion.q[row], neighbour.q[other], np.full(motion.q.shape[1], _APART)):
        return "is in another posture there"
    if not _near(motion.v[row], neighbour.v[other], velocity_tolerance(robot)):
        return "moves otherwise there"
    for foot, flags in motion.contacts.items():
        flag = neighbour.contacts.get(foot)
        if flag is None or flag[other] != flags[row]:
            return "stands on other feet there"
    return None


def _near(a: Array, b: Array, tolerance: Array) -> bool:
    return a.shape == b.shape and bool((np.abs(a - b) <= tolerance).all())
