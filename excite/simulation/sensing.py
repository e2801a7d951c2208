"""From what happened in a run to what the robot's sensors would have logged of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array, Flags
from excite.logs.header_blocks import ImuHeader, TrialHeader
from excite.logs.log import LogHeader, Trial
from excite.logs.robot import foot_headers, sensor_headers
from excite.motion.motion import Motion
from excite.robot.joint_values import per_joint
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.simulation.true_parameters import nominal_drives
from excite.simulation.virtual_robot import Recording, VirtualRobot

# Share of the weight above which a foot counts as carrying: what it carries below that is lost in the torques' noise.
CONTACT_SHARE = 0.005


def sense_recording(
    virtual: VirtualRobot, recording: Recording, role: str, rng: np.random.Generator
) -> Trial:
    """What the sensors that ``robot.yaml`` declares say of a run.

    Args:
        virtual: the robot; its ``readings`` act on the recording first, then noise is added.
        recording: what happened.
        role: ``identification`` or ``validation``.
        rng: source of the noise; numbers are drawn in a fixed order whatever the level of noise.

    Returns:
        The trial: joint positions and commands; for a free base its pose, IMU where it has one, and the contact
        wrenches or flags; joint torques where the robot measures them.
    """
    for reading in virtual.readings:
        recording = reading(recording)
    robot, level = virtual.robot, virtual.noise
    sensors = robot.description.sensors
    n, joints = len(recording.time), robot.n_joints
    q = recording.q[:, robot.n_base_q :] + level * sensors.noise_position * rng.standard_normal((n, joints))
    base, wrenches, tau = None, {}, None
    if robot.floating:
        noise = level * rng.standard_normal((n, 6))
        base = _noisy_pose(
            recording.q[:, :7],
            sensors.noise_base_position * noise[:, :3],
            sensors.noise_base_orientation * noise[:, 3:],
        )
    imu = None
    if sensors.imu is not None and robot.floating:
        sigma = np.repeat([sensors.imu.noise_gyro, sensors.imu.noise_acceleration], 3)
        imu = imu_readings(robot, recording) + level * sigma * rng.standard_normal((n, 6))
    for sensor in robot.sensors:
        sigma = np.repeat([sensor.noise_force, sensor.noise_moment], 3)
        wrenches[sensor.name] = recording.wrenches[sensor.name] + level * sigma * rng.standard_normal((n, 6))
    if sensors.joint_torque is not None:
        sigma = per_joint(sensors.noise_torque, robot.joint_names, np.zeros(joints))
        true = recording.tau_link if sensors.joint_torque == "link_side" else recording.tau_motor
        tau = true + level * sigma * rng.standard_normal((n, joints))
    motors = ~robot.passive
    return Trial(
        name=recording.name,
        role=role,
        time=recording.time,
        q=q[:, motors],
        tau=None if tau is None else tau[:, motors],
        q_cmd=recording.q_cmd[:, motors],
        base=base,
        wrenches=wrenches,
        imu=imu,
        contacts={} if robot.measures_contacts else contact_flags(robot, recording),
    )


def imu_readings(robot: Robot, recording: Recording | Motion) -> Array:
    """Angular velocity [rad/s] and acceleration less gravity [m/s²] at the IMU, in its frame, ``(n, 6)``."""
    placement = pin.SE3.Identity()
    if robot.description.sensors.imu is not None:
        link = robot.description.sensors.imu.link
        _, placement = link_placement(robot.model, link, robot.source, "sensors.imu.link")
    rotation, lever = placement.rotation, placement.translation
    turn = scipy.spatial.transform.Rotation.from_quat(recording.q[:, 3:7]).as_matrix() @ rotation
    linear, angular, acceleration = (
        part @ rotation
        for part in (
            recording.v[:, :3] + np.cross(recording.v[:, 3:6], lever),
            recording.v[:, 3:6],
            recording.a[:, :3] + np.cross(recording.a[:, 3:6], lever),
        )
    )
    gravity = np.array(robot.description.gravity)
    return np.hstack([angular, acceleration + np.cross(angular, linear) - gravity @ turn])


def contact_flags(robot: Robot, recording: Recording) -> dict[str, Flags]:
    """Whether the ground presses on each foot, as a switch in it would say, ``(n,)`` by foot name."""
    threshold = CONTACT_SHARE * robot.mass * float(np.linalg.norm(robot.description.gravity))
    return {foot.name: recording.contacts[foot.name][:, 2] > threshold for foot in robot.feet}


def log_header(robot: Robot, trials: tuple[TrialHeader, ...]) -> LogHeader:
    """The header of a log of a virtual robot: its declared sensors and servo, of joints that have a motor.

    The baseline that it names has rigid bodies; where joint torques are measured it also has viscous and
    Coulomb friction, and rotor inertia where the motors' torque is measured and ``robot.yaml`` declares one.
    """
    description = robot.description
    torque, imu = description.sensors.joint_torque, description.sensors.imu
    drives, motors = nominal_drives(robot), ~robot.passive
    modelled = ["rigid_body"]
    if torque is not None:
        modelled += ["viscous_friction", "coulomb_friction"]
    if torque == "motor_side" and drives.armature.any():
        modelled.append("armature")
    return LogHeader(
        schema="excite.log/1",
        robot="robot.urdf" if robot.mechanism is None else "robot.yaml",
        base=description.base,
        gravity=description.gravity,
        rate_hz=description.sensors.rate_hz,
        joints=robot.driven_names,
        torque=torque or "none",
        controller={
            "mode": "position",
            "kp": dict(zip(robot.driven_names, drives.kp[motors].tolist(), strict=True)),
            "kd": dict(zip(robot.driven_names, drives.kd[motors].tolist(), strict=True)),
            "feedforward": "none",
            "velocity_reference": "derivative of q_cmd",
            "rate_hz": drives.rate_hz,
            "torque_limit": dict(zip(robot.driven_names, drives.torque_limit[motors].tolist(), strict=True)),
        },
        base_link=robot.base_link if robot.floating else None,
        wrench="on_robot_in_sensor_frame" if robot.sensors else None,
        sensors=sensor_headers(robot) if robot.sensors else (),
        feet=() if robot.measures_contacts else foot_headers(robot),
        imu=None if imu is None or not robot.floating else ImuHeader(**imu.model_dump()),
        modelled=tuple(modelled),
        trials=trials,
    )


def _noisy_pose(pose: Array, position: Array, rotation: Array) -> Array:
    """Poses ``(n, 7)`` shifted by ``position`` (world) and turned by ``rotation`` (body frame)."""
    turned = np.array(
        [
            (pin.Quaternion(quaternion) * pin.Quaternion(pin.exp3(vector))).normalized().coeffs()
            for quaternion, vector in zip(pose[:, 3:], rotation, strict=True)
        ]
    )
    return np.hstack([pose[:, :3] + position, turned])


# Readings of contact wrench sensors, from contact forces and the motion of what lies beyond the sensor.


def sensor_wrenches(
    robot: Robot, phi: Array, q: Array, v: Array, a: Array, contacts: Mapping[str, Array]
) -> dict[str, Array]:
    """Wrench exerted on the robot through each sensor.

    A force plate reads the whole contact wrench. A sensor in the ankle carries the foot: by Newton and Euler
    it reads the contact wrench less what the segments beyond it need to move and against gravity.

    Args:
        robot: the robot.
        phi: true inertial parameters, ``(10·n_segments,)``.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        contacts: by foot name, ``(n, 6)``: force, moment about the world's origin, world frame.

    Returns:
        By sensor name, ``(n, 6)``: force [N], then moment about the sensor's origin [N·m], in its frame.
    """
    wrenches = {sensor.name: np.zeros((len(q), 6)) for sensor in robot.sensors}
    model, data = robot.model, robot.model.createData()
    massive = {
        sensor.name: [index for index in sensor.excludes if phi[10 * index] > 0.0] for sensor in robot.sensors
    }
    gravity = np.array(robot.description.gravity)
    for row in range(len(q)):
        if robot.sensors:
            pin.forwardKinematics(model, data, q[row], v[row], a[row])
        for sensor in robot.sensors:
            pose = data.oMi[sensor.joint] * sensor.placement
            reading = pose.actInv(pin.Force(contacts[sensor.foot][row]))
            for segment in massive[sensor.name]:
                needed = _needed_wrench(data, segment + 1, phi[10 * segment : 10 * segment + 10], gravity)
                reading -= pose.actInv(data.oMi[segment + 1].act(needed))
            wrenches[sensor.name][row] = reading.vector
    return wrenches


def _needed_wrench(data: pin.Data, joint: int, phi: Array, gravity: Array) -> pin.Force:
    """Wrench that a moving body needs, about its joint frame's origin and in that frame."""
    inertia = pin.Inertia.FromDynamicParameters(phi)
    twist = data.v[joint]
    free_fall = pin.Motion(data.oMi[joint].rotation.T @ gravity, np.zeros(3))
    return inertia * (data.a[joint] - free_fall) + twist.cross(inertia * twist)
