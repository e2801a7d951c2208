"""What it takes to hold a robot still: torques of gravity on the joints that no contact relieves."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

# Share of the torque limit that motions use, so that the verdict finds a margin.
TORQUE_SHARE = 0.85
# However much friction a drive has, this share of its limit is left to motions: friction that the URDF states is often
# a simulator's damping, at full speed more than the drive can give.
_LEFT_BY_FRICTION = 0.3


def usable_torque(robot: Robot, share: Array, speed: Array) -> Array:
    """Torque that is left to gravity and inertia beside friction ``(n_joints,)`` [N·m or N].

    Args:
        robot: its limits and its drives' friction.
        share: of the torque limit that may be used, ``(n_joints,)``.
        speed: at which viscous friction counts, ``(n_joints,)`` [rad/s or m/s].
    """
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    viscous = per_joint(drives.viscous, robot.joint_names, nothing)
    coulomb = per_joint(drives.coulomb, robot.joint_names, nothing)
    limit = robot.limits.torque
    return np.asarray(np.maximum(share * limit - coulomb - viscous * speed, _LEFT_BY_FRICTION * limit))


def holding_torques(robot: Robot, joints: Array, data: pin.Data | None = None) -> Array:
    """Torques that hold a robot still in postures ``(n, n_joints)``, its base at rest, ``(n, n_joints)`` [N·m or N].

    Zero for joints between a floating base and a foot: theirs depend on how the contacts share the load.

    Args:
        robot: the robot.
        joints: the postures.
        data: pinocchio's room for its model, where that is at hand: of a G1, making it takes as long as 80 postures.
    """
    q = np.tile(robot.rest, (len(joints), 1))
    q[:, robot.n_base_q :] = joints
    data = robot.model.createData() if data is None else data
    tau = np.array([pin.computeGeneralizedGravity(robot.model, data, row).copy() for row in q])
    tau = robot.on_motors(q, tau.reshape(len(q), robot.model.nv))
    tau[:, _carrying_velocities(robot)] = 0.0
    return np.asarray(tau.reshape(len(joints), robot.model.nv)[:, robot.n_base_v :])


@lru_cache(maxsize=4)
def _carrying_velocities(robot: Robot) -> list[int]:
    """Velocities of the joints between a floating base and a foot, and of motors that move these."""
    columns: list[int] = []
    for foot in robot.feet if robot.floating else ():
        carrying = list(robot.model.supports[foot.joint])[1:]
        of_foot = [robot.model.idx_vs[joint] for joint in carrying if robot.model.nvs[joint] == 1]
        if robot.mechanism is not None:
            moves = robot.mechanism.motion_maps(robot.rest[None])[0][of_foot]
            of_foot += list(robot.mechanism.driven[np.abs(moves).max(axis=0) > 0.0])
        columns += of_foot
    return columns
