"""The measured side of a floating robot's base equation: sensor readings brought to the base."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot


def base_wrench(robot: Robot, q: Array, wrenches: Mapping[str, Array]) -> Array:
    """Sum of the measured contact wrenches at the base: Σ J1ᵀ f (Jovic et al. 2015, eq. 2, right-hand side).

    Args:
        robot: a floating robot with wrench sensors.
        q: ``(n, nq)`` configurations.
        wrenches: by sensor, ``(n, 6)``: force [N] and moment [N·m] that the ground exerts on the robot,
            in the sensor's frame, moment about its origin. An ankle sensor moves with its link, a force plate
            is fixed in the world. Sensors that are left out count as unloaded.

    Returns:
        ``(n, 6)`` force and moment about the base's origin, in the base frame.

    Raises:
        InputError: wrong shape, or a fixed-base robot.
        UnknownNameError: a sensor that the robot does not have.
    """
    if not robot.floating:
        raise InputError(f"robot {robot.name!r} has a fixed base", remedy="use its joint torques")
    sensors = {sensor.name: sensor for sensor in robot.sensors}
    poses = forward_kinematics(robot.model, q)
    base_rotation, base_origin = poses.rotation[:, 1], poses.translation[:, 1]
    total = np.zeros((len(q), 6))
    for name, wrench in wrenches.items():
        if name not in sensors:
            raise UnknownNameError("sensor", name, sorted(sensors))
        wrench = np.asarray(wrench, dtype=float)
        if wrench.shape != total.shape:
            raise InputError(f"wrench {name!r} has shape {wrench.shape}", remedy=f"expected {total.shape}")
        sensor = sensors[name]
        rotation = poses.rotation[:, sensor.joint] @ sensor.placement.rotation
        lever = poses.point(sensor.joint, sensor.placement.translation) - base_origin
        force = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
        moment = np.einsum("nij,nj->ni", rotation, wrench[:, 3:]) + np.cross(lever, force)
        total[:, :3] += np.einsum("nji,nj->ni", base_rotation, force)
        total[:, 3:] += np.einsum("nji,nj->ni", base_rotation, moment)
    return total
