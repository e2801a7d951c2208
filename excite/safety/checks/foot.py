"""Feet that carry load stay where they are, the others stay above the ground."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# Chosen here, below what a foot's rubber and the ground's unevenness take up:
HEIGHT_TOLERANCE = 0.003  # height of a loaded sole's corner above or below the ground [m]
SLIP_TOLERANCE = 0.003  # way of a loaded sole's corner from where it was put down [m]
SLIP_SPEED_TOLERANCE = 0.03  # its horizontal speed [m/s]


class FootCheck(Check):
    """Soles against level ground at height zero, at every sample of the finer grid.

    While a foot's contact flag is set, each corner of its sole stays within 3 mm of the ground and within 3
    mm horizontally of where the phase began, and moves at no more than 0.03 m/s. While it is not set no
    corner is more than 3 mm below the ground.
    """

    name: ClassVar[str] = "foot"

    def judge(self, sweep: Sweep) -> CheckResult:
        if not sweep.robot.feet:
            return CheckResult(applicable=False)
        found: list[Violation] = []
        for i, foot in enumerate(sweep.robot.feet):
            found += _judge_foot(foot.name, sweep.fine.time, sweep.sole_corners[i], sweep.contacts[:, i])
        return CheckResult(violations=tuple(found))


def _judge_foot(name: str, time: Array, corners: Array, loaded: NDArray[np.bool_]) -> list[Violation]:
    low, high = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    slip, speed = np.zeros(len(time)), np.zeros(len(time))
    # A phase starts where the flag rises.
    starts = np.flatnonzero(loaded & ~np.r_[False, loaded[:-1]])
    for start in starts:
        end = start + int(np.argmin(loaded[start:])) if not loaded[start:].all() else len(time)
        ground = corners[start:end, :, :2]
        slip[start:end] = np.linalg.norm(ground - ground[0], axis=2).max(axis=1)
        step = np.linalg.norm(np.diff(ground, axis=0), axis=2).max(axis=1)
        speed[start : end - 1] = step / np.diff(time[start:end])
    cases = (
        ("foot_lifted", loaded & ~(high <= HEIGHT_TOLERANCE), high, HEIGHT_TOLERANCE),
        ("foot_below_ground", ~(low >= -HEIGHT_TOLERANCE), low, -HEIGHT_TOLERANCE),
        ("foot_slip", loaded & ~(slip <= SLIP_TOLERANCE), slip, SLIP_TOLERANCE),
        ("foot_slip_speed", loaded & ~(speed <= SLIP_SPEED_TOLERANCE), speed, SLIP_SPEED_TOLERANCE),
    )
    found = []
    for kind, bad, values, limit in cases:
        if bad.any():
            row = int(np.argmax(bad))
            found.append(Violation(kind, float(time[row]), name, float(values[row]), limit))
    return found
