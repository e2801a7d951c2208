"""Position, velocity and acceleration limits of the joints, at every instant.

All three bound the Bézier control points of the interpolant on the finer grid (see
:mod:`~excite.safety.checks.control_points`), so nothing passes its limit between samples.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.safety.checks.base import Check, CheckResult, first_violations, nearest_joints
from excite.safety.checks.sweep import Sweep

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


def magnitude_result(kind: str, sweep: Sweep, values: Array, limits: Array) -> CheckResult:
    """Judge magnitudes on the finer grid's intervals, ``(n-1, n_joints)``, against each joint's limit."""
    bad = ~(values <= limits * (1.0 + _ROUNDING))
    violations = first_violations(kind, sweep.robot.joint_names, sweep.fine.time, values, limits, bad)
    room = limits - values
    nearest = nearest_joints(kind, sweep.robot, room.min(axis=0))
    return CheckResult(float(room.min()), violations, nearest=nearest)
