"""Readings of contact wrench sensors, from contact forces and the motion of what lies beyond the sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.robot import Robot


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
