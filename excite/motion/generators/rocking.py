"""How slowly a robot rocks sideways on the springs that its servos are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.motion.generators.bodyparts import leg_joints, sole_half_width
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

# Gain of a servo that nobody stated, in weights of the robot times the height of its centre of mass per radian: as
# stiff as those of the bundled robots.
_STIFFNESS = 25.0
# How far a sole sinks into the ground under the robot's weight [m], as hard rubber does: with this a narrow sole is a
# softer spring than the leg above it.
_SINK = 1e-4
# An axis this near to the forward direction bends the leg sideways.
_SIDEWAYS = 0.7


def rocking_period(robot: Robot) -> float:
    """Period of the sideways oscillation on one leg [s].

    The robot is a rigid inverted pendulum; the roll joints of the leg, as stiff as the position servo's gains, and the
    edges of the sole are springs in series: ``T = 2π √(I / (k − m g h))``.
    """
    model, data = robot.model, robot.model.createData()
    pin.crba(model, data, robot.rest)
    centre = np.array(pin.centerOfMass(model, data, robot.rest))
    height = float(centre[2])
    weight = robot.mass * float(np.linalg.norm(model.gravity.linear))
    pin.ccrba(model, data, robot.rest, np.zeros(model.nv))
    inertia = float(data.Ig.inertia[0, 0]) + robot.mass * height**2
    usual = np.full(robot.n_joints, _STIFFNESS * weight * height)
    gains = per_joint(robot.description.controller.kp, robot.joint_names, usual)
    pin.forwardKinematics(model, data, robot.rest)
    pin.computeJointJacobians(model, data, robot.rest)
    foot = robot.feet[0]
    softness = float(_SINK / (weight * sole_half_width(foot) ** 2))
    for index in leg_joints(robot, foot):
        joint = model.getJointId(robot.joint_names[index])
        axis = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[3:, model.idx_vs[joint]]
        if abs(axis[0]) > _SIDEWAYS:
            softness += 1.0 / gains[index]
    stiffness = 1.0 / softness
    return float(2.0 * np.pi * np.sqrt(inertia / max(stiffness - weight * height, 0.5 * stiffness)))
