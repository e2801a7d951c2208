"""What Franka's control interface lets joints do.

The numbers are those of the maker's page "Control Interface Specification and Robot Limits" and of libfranka's
``rate_limiting.h`` (0.9.2 for the Franka Emika Robot, which is also called Panda; 0.13 and later for the Franka
Research 3). A command that is beyond one of them in one millisecond ends the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.safety.verdict import Violation

PERIOD_S = 1e-3
# libfranka compares with limits that are smaller by this.
_EPSILON = 1e-3
# Milliseconds of standing still before the first and after the last sample, as the robot starts and ends.
_STILL = 3


@dataclass(frozen=True)
class FrankaLimits:
    """Limits of the seven joints of one model.

    Attributes:
        velocity: [rad/s].
        acceleration: [rad/s²].
        jerk: [rad/s³].
        braking: by joint ``(offset, slope, lower end, upper end)``: near an end of its range at distance d a joint may
            be no faster towards it than √(slope·d) − offset [rad/s]; empty for a model that has constant limits.
    """

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    braking: tuple[tuple[float, float, float, float], ...] = ()

    def velocities(self, q: Array) -> tuple[Array, Array]:
        """Lowest and highest velocity at positions ``(n, 7)``, the same shape each."""
        top = np.tile(self.velocity, (len(q), 1))
        if not self.braking:
            return -top, top
        offset, slope, lower, upper = np.array(self.braking).T
        up = np.maximum(0.0, np.sqrt(np.maximum(0.0, slope * (upper - q))) - offset)
        down = np.maximum(0.0, np.sqrt(np.maximum(0.0, slope * (q - lower))) - offset)
        return -np.minimum(top, down), np.minimum(top, up)


LIMITS = {
    "panda": FrankaLimits(
        (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
        (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
        (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
    ),
    "fr3": FrankaLimits(
        (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
        (10.0,) * 7,
        (5000.0,) * 7,
        (
            (0.30, 12.0, -2.7501, 2.7501),
            (0.20, 5.17, -1.7918, 1.7918),
            (0.20, 7.0, -2.9065, 2.9065),
            (0.30, 8.0, -3.0481, -0.1458),
            (0.35, 34.0, -2.8101, 2.8101),
            (0.35, 11.0, 0.54092, 4.5205),
            (0.35, 34.0, -3.0196, 3.0196),
        ),
    ),
}


def franka_violations(limits: FrankaLimits, q: Array, joints: tuple[str, ...]) -> tuple[Violation, ...]:
    """Where a stream of positions is beyond the limits, the first time of each kind and joint.

    Velocity, acceleration and jerk are differences from millisecond to millisecond, as the robot takes them, from and
    to a robot that stands still.

    Args:
        limits: of the model.
        q: ``(n, 7)`` positions, one a millisecond [rad].
        joints: their names.
    """
    still = np.vstack([np.tile(q[0], (_STILL, 1)), q, np.tile(q[-1], (_STILL, 1))])
    v = np.diff(still, axis=0) / PERIOD_S
    a = np.diff(v, axis=0) / PERIOD_S
    jerk = np.diff(a, axis=0) / PERIOD_S
    low, high = limits.velocities(still[1:])
    found: list[Violation] = []
    for kind, values, limit in (
        ("franka_velocity", v, np.where(v >= 0.0, high, -low)),
        ("franka_acceleration", a, np.array(limits.acceleration)),
        ("franka_jerk", jerk, np.array(limits.jerk)),
    ):
        beyond = np.abs(values) > limit - _EPSILON
        for joint in np.flatnonzero(beyond.any(axis=0)):
            row = int(np.argmax(beyond[:, joint]))
            time = max(0.0, (row + len(still) - len(values) - _STILL) * PERIOD_S)
            most = float(np.broadcast_to(limit, values.shape)[row, joint])
            found.append(Violation(kind, time, joints[joint], float(abs(values[row, joint])), most))
    return tuple(found)
