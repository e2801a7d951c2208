"""Which joints belong to legs and which to the upper body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.robot.robot import Array, Foot, Robot


def leg_joints(robot: Robot, foot: Foot) -> tuple[int, ...]:
    """Indices into ``joint_names`` of the joints between base and foot, from the base on."""
    chain = [int(joint) for joint in robot.model.supports[foot.joint]]
    first = 2 if robot.floating else 1
    return tuple(joint - first for joint in chain if joint >= first)


def upper_body(robot: Robot) -> NDArray[np.bool_]:
    """Which actuated joints are in no leg, ``(n_joints,)``; all of a robot without feet."""
    upper = np.ones(robot.n_joints, dtype=bool)
    for foot in robot.feet:
        upper[list(leg_joints(robot, foot))] = False
    return upper


def rest_joints(robot: Robot) -> Array:
    """Positions of the actuated joints at rest, ``(n_joints,)`` [rad or m]."""
    return robot.rest[robot.n_base_q :].copy()


def central_range(robot: Robot, share: float = 0.8) -> tuple[Array, Array]:
    """Bounds of the central ``share`` of each joint's range (0.8: from 10 % to 90 %), ``(n_joints,)`` each."""
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    edge = 0.5 * (1.0 - share) * (upper - lower)
    return lower + edge, upper - edge
