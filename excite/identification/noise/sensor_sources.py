"""The sensors' noise, and the way it takes to the rows of a regression at each instant of a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.problem import IdentificationProblem
from excite.motion.motion import Motion, closed_contacts
from excite.regressor.contact_forces import contact_elimination
from excite.regressor.wrench import base_wrench
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """White noise of a group of sensors and the way it takes to the rows.

    Attributes:
        std: ``(n_sensors,)`` standard deviation of each at the rate of the log [SI].
        gains: by order of time derivative, ``(n_samples, n_channels, n_sensors)``.
        positions: whether it goes through the filter of the kinematics too.
    """

    std: Array
    gains: tuple[Array, ...]
    positions: bool


def noise_sources(robot: Robot, problem: IdentificationProblem, motion: Motion) -> tuple[NoiseSource, ...]:
    """Noise of forces and of positions along a motion.

    Args:
        robot: the robot.
        problem: names the drives' parameters and holds their values.
        motion: sampled where the rows are wanted.

    Raises:
        InputError: joint torques whose description does not state their noise.
    """
    positions = _position_source(robot, problem, motion)
    if robot.measures_contacts:
        return _wrench_source(robot, motion), positions
    sources: tuple[NoiseSource, ...] = (_torque_source(robot, motion), positions)
    if robot.floating and robot.description.sensors.imu is not None:
        sources = (sources[0], *_imu_sources(robot, positions))
    if not robot.passive.any():
        return sources
    # Rows are the motors' alone.
    motors = ~robot.passive
    return tuple(replace(one, gains=tuple(gain[:, motors] for gain in one.gains)) for one in sources)


def _torque_source(robot: Robot, motion: Motion) -> NoiseSource:
    block = robot.description.sensors.noise_torque
    std = per_joint(block, robot.joint_names, np.full(robot.n_joints, np.nan))
    std[robot.passive] = 0.0
    if np.isnan(std).any():
        raise InputError(
            f"no noise of joint {robot.joint_names[int(np.argmax(np.isnan(std)))]!r}",
            source=robot.source,
            field="sensors.noise_torque",
            remedy="state its standard deviation",
        )
    gain = np.broadcast_to(np.eye(robot.n_joints), (motion.n_samples, robot.n_joints, robot.n_joints))
    if robot.floating:
        gain = _contact_elimination(robot, motion)[:, :, robot.n_base_v :]
    return NoiseSource(std, (gain,), positions=False)


def _contact_elimination(robot: Robot, motion: Motion) -> Array:
    return contact_elimination(robot, motion.q, closed_contacts(robot, motion))


def _wrench_source(robot: Robot, motion: Motion) -> NoiseSource:
    n = motion.n_samples
    gain, std = np.zeros((n, 6, 6 * len(robot.sensors))), np.zeros(6 * len(robot.sensors))
    # What each axis of a sensor reads alone, one after the other in each sample's configuration.
    units, q = np.tile(np.eye(6), (n, 1)), np.repeat(motion.q, 6, axis=0)
    for place, sensor in enumerate(robot.sensors):
        own = slice(6 * place, 6 * place + 6)
        std[own] = np.repeat([sensor.noise_force, sensor.noise_moment], 3)
        gain[:, :, own] = base_wrench(robot, q, {sensor.name: units}).reshape(n, 6, 6).swapaxes(1, 2)
    return NoiseSource(std, (gain,), positions=False)


def _position_source(robot: Robot, problem: IdentificationProblem, motion: Motion) -> NoiseSource:
    """Derivatives of the inverse dynamics of the nominal model and its drives.

    Where contact forces are taken out, how these change with position is left out: it is the stiffness of the
    contacts' geometry, of the order of gravity's own. So is how a mechanism's transmission changes with it.
    """
    sensors, model = robot.description.sensors, robot.model
    std = np.full(model.nv, sensors.noise_position)
    if robot.floating:
        std[:6] = np.repeat([sensors.noise_base_position, sensors.noise_base_orientation], 3)
    rows = 6 if robot.measures_contacts else model.nv
    gains = np.empty((3, motion.n_samples, rows, model.nv))
    data = model.createData()
    for t in range(motion.n_samples):
        found = pin.computeRNEADerivatives(model, data, motion.q[t], motion.v[t], motion.a[t])
        for order, matrix in enumerate(found):
            gains[order, t] = np.asarray(matrix)[:rows]
        # pinocchio fills the upper triangle of the mass matrix only.
        upper = np.triu(np.asarray(found[2]))
        gains[2, t] = (upper + np.triu(upper, 1).T)[:rows]
    drives = dict(
        zip(problem.parameter_names[problem.n_inertial :], problem.prior[problem.n_inertial :], strict=True)
    )
    for order, term in ((1, "viscous"), (2, "armature")):
        for index, joint in enumerate(robot.joint_names):
            if not robot.measures_contacts:
                row = robot.n_base_v + index
                gains[order, :, row, row] += drives.get(f"{term}.{joint}", 0.0)
    if robot.mechanism is not None and not robot.measures_contacts:
        maps = np.zeros((motion.n_samples, model.nv, model.nv))
        maps[:, :, robot.mechanism.driven] = robot.mechanism.motion_maps(motion.q)
        gains = maps.transpose(0, 2, 1) @ gains @ maps
    if robot.floating and not robot.measures_contacts:
        gains = _contact_elimination(robot, motion) @ gains
    return NoiseSource(std, tuple(gains), positions=True)


def _imu_sources(robot: Robot, positions: NoiseSource) -> tuple[NoiseSource, NoiseSource]:
    """Noise of joint positions, and of an IMU's gyroscope and accelerometer in place of the base's pose.

    The lever from the base's origin to the IMU is left out.
    """
    imu = robot.description.sensors.imu
    position, velocity, acceleration = positions.gains
    joints = NoiseSource(positions.std[6:], tuple(gain[:, :, 6:] for gain in positions.gains), positions=True)
    if imu is None:
        return joints, joints
    nothing = np.zeros_like(position[:, :, :3])
    gains = (
        np.concatenate([velocity[:, :, 3:6], acceleration[:, :, :3]], axis=2),
        np.concatenate([acceleration[:, :, 3:6], nothing], axis=2),
    )
    return joints, NoiseSource(np.repeat([imu.noise_gyro, imu.noise_acceleration], 3), gains, positions=True)
