"""Arms of a blind benchmark: a used robot, its sensors, its session of trials."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.drives import nominal_drives
from excite.simulation.mjcf import World
from excite.simulation.true_parameters import moved_inertia, nominal_truth, scattered_parameters
from excite.simulation.virtual_robot import VirtualRobot

RATE_HZ = 200.0
TRIAL_S, PAUSE_S = 10.0, 2.0
N_TRIALS, N_VALIDATION = 5, 2


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm before anything is hidden in it.

    Attributes:
        virtual: the robot, its drives' dry and viscous friction and rotor inertia all there.
        motions: one a command: identification trials, then validation trials.
        load: ``(n_joints,)`` standard deviation of the torque that the links need [N·m].
        torque: ``(n_joints,)`` typical torque of the motor, friction included [N·m].
        inertia: ``(n_joints,)`` inertia that each joint moves [kg·m²].
    """

    virtual: VirtualRobot
    motions: tuple[Motion, ...]
    load: Array
    torque: Array
    inertia: Array


def arm_of(robot: Robot, fixed: bool, rng: np.random.Generator) -> Arm:
    """A used arm and the motions of its session.

    Args:
        robot: an arm.
        fixed: whether its inertial parameters are the model's; else they are scattered.
        rng: source of all that is drawn.

    Returns:
        The arm.
    """
    sensors = robot.description.sensors.model_copy(update={"rate_hz": RATE_HZ, "joint_torque": "motor_side"})
    robot = replace(robot, description=robot.description.model_copy(update={"sensors": sensors}))
    motions = tuple(_fourier_motion(robot, f"trial_{k:02d}", rng) for k in range(N_TRIALS + N_VALIDATION))
    load = np.vstack([_needed_torques(robot, motion) for motion in motions]).std(axis=0)
    inertia = np.array([moved_inertia(robot, name) for name in robot.joint_names])
    n = robot.n_joints
    # Small joints have small rotors and large gear ratios.
    armature = np.maximum(inertia * rng.uniform(0.1, 0.4, n), 0.01 * inertia.max())
    speed_up = np.vstack([motion.a for motion in motions]).std(axis=0)
    size = np.hypot(load, armature * speed_up) + 0.002 * load.max()
    drives = replace(
        nominal_drives(robot),
        coulomb=size * rng.uniform(0.06, 0.25, n),
        viscous=size * rng.uniform(0.04, 0.2, n),
        armature=armature,
    )
    truth = nominal_truth(robot) if fixed else scattered_parameters(robot, rng, scatter=0.08)
    virtual = VirtualRobot(robot, truth, drives, World(timestep=1e-3))
    return Arm(virtual, motions, load, size + drives.coulomb, inertia)


def _fourier_motion(robot: Robot, name: str, rng: np.random.Generator) -> Motion:
    """A finite Fourier series that starts and ends at rest (Swevers et al. 1997)."""
    n, limits = robot.n_joints, robot.limits
    time = np.arange(round(TRIAL_S * RATE_HZ) + 1) / RATE_HZ
    s = np.clip(np.minimum(time, TRIAL_S - time) / 0.8, 0.0, 1.0)
    window = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    harmonics = np.arange(1, 6) * 2.0 * np.pi / TRIAL_S * rng.uniform(1.0, 1.3)
    low, high = limits.position_lower, limits.position_upper
    centre = np.clip(robot.rest + rng.uniform(-0.5, 0.5, n), low + 0.3, high - 0.3)
    q = np.empty((len(time), n))
    for j in range(n):
        a, b = rng.standard_normal((2, 5)) / np.sqrt(np.arange(1, 6))
        wave = np.cos(np.outer(time, harmonics)) @ a + np.sin(np.outer(time, harmonics)) @ b
        wave = window * (wave - wave.mean())
        speed = np.abs(np.gradient(wave, time)).max()
        reach = max(wave.max() / (high[j] - centre[j]), -wave.min() / (centre[j] - low[j]))
        fastest = min(1.6, 0.8 * limits.velocity[j])
        q[:, j] = centre[j] + wave * min(fastest / speed, 0.95 / reach)
    v = np.gradient(q, time, axis=0)
    return Motion(name, robot.name, robot.joint_names, time, q, v, np.gradient(v, time, axis=0))


def _needed_torques(robot: Robot, motion: Motion) -> Array:
    data = robot.model.createData()
    rows = range(0, motion.n_samples, 20)
    return np.array([pin.rnea(robot.model, data, motion.q[k], motion.v[k], motion.a[k]) for k in rows])
