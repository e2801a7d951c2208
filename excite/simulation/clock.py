"""Steps of the physics and of the sensors in a run, as small as the feet need to stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.motion.motion import Motion
from excite.simulation.virtual_robot import VirtualRobot

# MuJoCo finds contact forces for the joints' own inertia and then takes the step with their damping added, so that a
# sole creeps where damping outweighs inertia: the share of a step's damping that is let be. A GR1 with the servos of a
# first description has 17 of it in steps of 0.5 ms, and its squats slip 8 and 21 mm in simulation; with half the steps
# 1.6 and 1.0 mm, with a quarter 0.7 and 0.6. Bundled humanoids have 3 to 5 of it in 0.5 ms.
_DAMPING = 9.0


@dataclass(frozen=True, eq=False)
class Clock:
    """Steps of the physics and of the sensors.

    Attributes:
        step: [s]
        per_sample: steps between two sensor samples.
        settle: steps before the motion starts, a multiple of ``per_sample``.
        samples: number of sensor samples.
    """

    step: float
    per_sample: int
    settle: int
    samples: int


def clock_of(virtual: VirtualRobot, motion: Motion, settle_s: float) -> Clock:
    """The clock of a run of a motion, which settles for ``settle_s`` [s] first."""
    period = 1.0 / virtual.robot.description.sensors.rate_hz
    per_sample = _steps_a_sample(virtual, period)
    samples = int(np.floor(motion.duration / period + 1e-9)) + 1
    settle = round(settle_s / period) * per_sample
    return Clock(period / per_sample, per_sample, settle, samples)


def step_of(virtual: VirtualRobot) -> float:
    """Step of the physics in any run of a virtual robot [s]."""
    period = 1.0 / virtual.robot.description.sensors.rate_hz
    return period / _steps_a_sample(virtual, period)


def _steps_a_sample(virtual: VirtualRobot, period: float) -> int:
    wanted = virtual.world.timestep
    if not virtual.world.feet_may_creep:
        wanted = min(wanted, steady_step(virtual))
    return max(1, int(np.ceil(period / wanted - 1e-9)))


def steady_step(virtual: VirtualRobot) -> float:
    """Longest step in which the soles of a robot do not creep [s]; infinite without feet."""
    robot, drives = virtual.robot, virtual.drives
    if not robot.floating or not robot.feet:
        return np.inf
    upper = np.triu(pin.crba(robot.model, robot.model.createData(), robot.rest))
    inertia = upper + np.triu(upper, 1).T
    joints = slice(robot.n_base_v, None)
    inertia[joints, joints] += np.diag(drives.armature)
    light = np.diag(np.linalg.inv(inertia))[joints]
    of_legs = np.zeros(robot.n_joints, dtype=bool)
    for foot in robot.feet:
        joint = foot.joint
        while joint > 1:
            of_legs[robot.joint_index(robot.model.names[joint])] = True
            joint = robot.model.parents[joint]
    damping = (light * (drives.kd + drives.total_viscous))[of_legs]
    return float(_DAMPING / damping.max(initial=1e-9))
