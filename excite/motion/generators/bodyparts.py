"""Which joints belong to legs and which to the upper body."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.robot import Foot, Robot


def pelvis_joint(robot: Robot) -> int:
    """Model joint that carries the body from which the legs part: the base's unless the base is a trunk."""
    chains = [set(robot.model.supports[foot.joint]) for foot in robot.feet]
    shared = set.intersection(*chains) if len(chains) > 1 else {1}
    return int(max(shared))


def pelvis_height(robot: Robot) -> float:
    """Height at rest of the frame of that body [m]."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    return float(data.oMi[pelvis_joint(robot)].translation[2])


def leg_joints(robot: Robot, foot: Foot) -> tuple[int, ...]:
    """Indices into ``joint_names`` of the joints between pelvis and foot, from the pelvis on."""
    pelvis = set(robot.model.supports[pelvis_joint(robot)])
    chain = [int(joint) for joint in robot.model.supports[foot.joint]]
    first = 2 if robot.floating else 1
    return tuple(joint - first for joint in chain if joint >= first and joint not in pelvis)


def upper_body(robot: Robot) -> NDArray[np.bool_]:
    """Which actuated joints are in no leg, ``(n_joints,)``; all of a robot without feet."""
    upper = np.ones(robot.n_joints, dtype=bool)
    for foot in robot.feet:
        upper[list(leg_joints(robot, foot))] = False
    return upper


def free_upper_body(robot: Robot) -> NDArray[np.bool_]:
    """The upper body less the joints between base and pelvis, ``(n_joints,)``.

    Where the base is a trunk, those move the feet unless the base moves along.
    """
    free = upper_body(robot)
    if robot.feet:
        free[[joint - 2 for joint in robot.model.supports[pelvis_joint(robot)] if joint >= 2]] = False
    return free


def rest_joints(robot: Robot) -> Array:
    """Positions of the actuated joints at rest, ``(n_joints,)`` [rad or m]."""
    return robot.rest[robot.n_base_q :].copy()


def central_range(robot: Robot, share: float = 0.8) -> tuple[Array, Array]:
    """Bounds of the central ``share`` of each joint's range (0.8: from 10 % to 90 %), ``(n_joints,)`` each."""
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    edge = 0.5 * (1.0 - share) * (upper - lower)
    return lower + edge, upper - edge
