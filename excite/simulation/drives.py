"""The drives of a virtual robot: servo gains, torque limits, friction and rotor inertia of every joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.robot.loading import per_joint
from excite.robot.robot import Array, Robot


@dataclass(frozen=True, eq=False)
class Drives:
    """What moves the joints; each array ``(n_joints,)`` in the order of ``Robot.joint_names``.

    Attributes:
        kp: position gain of the servo [N·m/rad or N/m].
        kd: velocity gain of the servo [N·m·s/rad or N·s/m].
        torque_limit: at which the servo's torque is clipped [N·m or N].
        viscous: viscous friction on the motor side of the joint [N·m·s/rad or N·s/m].
        coulomb: Coulomb friction on the motor side of the joint [N·m or N].
        armature: rotor inertia as felt at the joint [kg·m² or kg].
        rate_hz: rate at which the servo takes new commands [Hz].
    """

    kp: Array
    kd: Array
    torque_limit: Array
    viscous: Array
    coulomb: Array
    armature: Array
    rate_hz: float


def nominal_drives(robot: Robot) -> Drives:
    """The drives that ``robot.yaml`` declares; friction and armature that it leaves out are zero."""
    description, names = robot.description, robot.joint_names
    zero, missing = np.zeros(len(names)), np.full(len(names), np.nan)
    return Drives(
        kp=per_joint(description.controller.kp, names, missing),
        kd=per_joint(description.controller.kd, names, missing),
        torque_limit=robot.limits.torque.copy(),
        viscous=per_joint(description.drives.viscous, names, zero),
        coulomb=per_joint(description.drives.coulomb, names, zero),
        armature=per_joint(description.drives.armature, names, zero),
        rate_hz=description.controller.rate_hz,
    )
