"""Position, velocity, acceleration and jerk limits of the joints, at every instant.

The first three bound the Bézier control points of the interpolant on the finer grid (see
:mod:`~excite.safety.checks.control_points`), so nothing passes its limit between samples.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.motion.derivatives import thinned
from excite.safety.checks.base import Check, CheckResult, first_violations, nearest_joints
from excite.safety.checks.control_points import jerk_bounds
from excite.safety.checks.sweep import FINER, MIN_RATE_HZ, Sweep

# Rounding that a motion planned exactly to a limit may show, relative to the limit (to the range for
# positions).
_ROUNDING = 1e-6


class JointPositionCheck(Check):
    """Joints stay inside their range."""

    name: ClassVar[str] = "joint_position"
    margin_field: ClassVar[str | None] = "joint_position_rad"

    def judge(self, sweep: Sweep) -> CheckResult:
        limits, low, high = sweep.robot.limits, sweep.bounds.lowest, sweep.bounds.highest
        below, above = limits.position_lower - low, high - limits.position_upper
        excess = np.maximum(below, above)
        bad = excess > _ROUNDING * (limits.position_upper - limits.position_lower)
        values = np.where(below > above, low, high)
        passed = np.where(below > above, limits.position_lower, limits.position_upper)
        names, time = sweep.robot.joint_names, sweep.fine.time
        return CheckResult(
            float(-excess.max()),
            first_violations("joint_position", names, time, values, passed, bad),
            nearest=nearest_joints("joint_position", sweep.robot, -excess.max(axis=0)),
        )


class JointVelocityCheck(Check):
    """Joint speeds stay below their limits."""

    name: ClassVar[str] = "joint_velocity"
    margin_field: ClassVar[str | None] = "joint_velocity_rad_s"

    def judge(self, sweep: Sweep) -> CheckResult:
        return magnitude_result("joint_velocity", sweep, sweep.bounds.speed, sweep.robot.limits.velocity)


class JointAccelerationCheck(Check):
    """Joint accelerations stay below their limits."""

    name: ClassVar[str] = "joint_acceleration"
    margin_field: ClassVar[str | None] = "joint_acceleration_rad_s2"

    def judge(self, sweep: Sweep) -> CheckResult:
        values, limits = sweep.bounds.acceleration, sweep.robot.limits.acceleration
        return magnitude_result("joint_acceleration", sweep, values, limits)


class JointJerkCheck(Check):
    """Accelerations change no faster than the jerk limit lets them, at the start and the end from and to rest.

    Of dense samples the mean jerk from sample to sample is judged, which is never more than the motion's own: what is
    between them follows from rounded or smoothed derivatives. Samples that are further apart say less than the curve
    through them, whose control points are bounded. Of positions alone the jerk is that of the spline through no more
    than :data:`~excite.safety.checks.sweep.MIN_RATE_HZ` of them a second: six decimals at 500 Hz are 500 rad/s³.
    """

    name: ClassVar[str] = "joint_jerk"
    margin_field: ClassVar[str | None] = "joint_jerk_rad_s3"

    def judge(self, sweep: Sweep) -> CheckResult:
        motion, own = sweep.motion, (sweep.motion.n_samples - 1) / sweep.motion.duration
        if own * FINER < MIN_RATE_HZ * (1.0 - _ROUNDING):
            motion = sweep.fine
            values = jerk_bounds(motion)
        else:
            if motion.curve == "spline" and own >= 2.0 * MIN_RATE_HZ:
                motion = thinned(motion, int(own / MIN_RATE_HZ))
            values = np.abs(np.diff(motion.joint_accelerations(), axis=0)) / np.diff(motion.time)[:, None]
        step = np.diff(motion.time)
        for row, neighbour in ((0, motion.metadata.previous), (-1, motion.metadata.following)):
            if not neighbour:
                jump = np.abs(motion.joint_accelerations()[row]) / step[row]
                values[row] = np.maximum(values[row], jump)
        return magnitude_result("joint_jerk", sweep, values, sweep.robot.limits.jerk, motion.time)


def magnitude_result(
    kind: str, sweep: Sweep, values: Array, limits: Array, time: Array | None = None
) -> CheckResult:
    """Judge magnitudes on intervals, ``(n-1, n_joints)``, of the finer grid or of times, against each joint's limit."""
    bad = ~(values <= limits * (1.0 + _ROUNDING))
    time = sweep.fine.time if time is None else time
    violations = first_violations(kind, sweep.robot.joint_names, time, values, limits, bad)
    room = limits - values
    nearest = nearest_joints(kind, sweep.robot, room.min(axis=0))
    return CheckResult(float(room.min()), violations, nearest=nearest)
