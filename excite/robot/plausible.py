"""Numbers that are possible one by one and absurd together: units that were mixed up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.errors import RobotError
from excite.robot.robot import Array, Robot

MOST_OVERLOAD = 100.0
"""Torque that a robot's own weight asks of a joint at most, over the joint's limit.

The largest of 103 published models with torque limits has 4.6 (the waist of a humanoid); masses in grams and lengths
in millimetres make it a thousand times what it is.
"""

_EARTH = 9.81
_DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Overload:
    """A joint that cannot hold what it carries.

    Attributes:
        joint: its name.
        mass: that it carries [kg].
        arm: distance of that mass's centre from the joint's axis at rest [m].
        torque: its limit [N·m].
    """

    joint: str
    mass: float
    arm: float
    torque: float

    @property
    def ratio(self) -> float:
        """Weight times arm over the torque limit."""
        return self.mass * _EARTH * self.arm / self.torque

    def __str__(self) -> str:
        return (
            f"{self.mass:.3g} kg at {self.arm:.3g} m from the axis of {self.joint!r} weigh "
            f"{self.ratio:.3g} times its torque limit of {self.torque:g} N·m"
        )


def overload(robot: Robot, torque: Array) -> Overload | None:
    """The joint that can least hold its load, held out to the side, if it is beyond ``MOST_OVERLOAD``.

    Args:
        robot: the robot.
        torque: limits of its joints, ``(n_joints,)`` [N·m]; infinite where there is none.
    """
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, robot.rest)
    pin.centerOfMass(model, data, robot.rest)
    worst: Overload | None = None
    jacobian = pin.computeJointJacobians(model, data, robot.rest)
    for index, name in enumerate(robot.joint_names):
        joint = model.joints[model.getJointId(name)]
        turn = jacobian[3:, joint.idx_v]
        if not turn.any():
            # A slide.
            continue
        centre = data.oMi[joint.id].rotation @ data.com[joint.id]
        arm = float(np.linalg.norm(np.cross(turn, centre)))
        found = Overload(name, float(data.mass[joint.id]), arm, float(torque[index]))
        if found.ratio > MOST_OVERLOAD and (worst is None or found.ratio > worst.ratio):
            worst = found
    return worst


def check_plausible(robot: Robot) -> None:
    """Refuse a robot whose units do not go together.

    Raises:
        RobotError: a joint is a hundred times too weak for the weight it carries, or a velocity limit is the URDF's
            in degrees.
    """
    weak = overload(robot, robot.limits.torque)
    if weak is not None:
        raise RobotError(
            str(weak),
            source=robot.source,
            field="limits.torque",
            remedy="masses are kilograms and lengths metres in the URDF; else state the torque limits",
        )
    stated = robot.model.velocityLimit[robot.n_base_v :]
    ratio = robot.limits.velocity / np.where(stated > 0.0, stated, np.inf)
    # Within a hundredth of the factor, as rounded numbers are.
    wrong = np.abs(ratio / _DEGREES - 1.0) < 0.01
    if wrong.any():
        index = int(np.argmax(wrong))
        raise RobotError(
            f"is {robot.limits.velocity[index]:g}, {_DEGREES:.4g} times the URDF's: it looks like degrees",
            source=robot.source,
            field=f"limits.velocity.joints.{robot.joint_names[index]}",
            remedy="give rad/s",
        )
