"""Motion of a free base from the inertial measurement unit on it, without its pose."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.logs.log import LogHeader
from excite.logs.robot import imu_placement
from excite.logs.signals.differentiate import central_differences
from excite.robot.robot import Robot


def imu_motion(
    robot: Robot, header: LogHeader, readings: Array, orientation: Array, rate_hz: float
) -> tuple[Array, Array]:
    """Acceleration and angular velocity of the base, its linear velocity taken as zero.

    Inverse dynamics in the base's frame knows gravity and acceleration as their difference only, which is what an
    accelerometer reads, and does not know the base's linear velocity at all. So any orientation will do, and gravity
    in it is added to the reading; only where a ball touches the ground depends on it.

    Args:
        robot: the robot in the log; gravity is its model's.
        header: says where the IMU sits.
        readings: ``(n, 6)`` filtered angular velocity [rad/s] and acceleration less gravity [m/s²], IMU's frame.
        orientation: ``(n, 4)`` quaternions x y z w of the base, as they will stand in the configuration.
        rate_hz: their rate.

    Returns:
        ``(n, 6)`` linear and angular acceleration in the base's frame, and ``(n, 3)`` angular velocity.

    Raises:
        LogError: the IMU's link moves against the base.
    """
    # scipy.spatial takes 0.2 s to load, and rows of a fixed base need none of it.
    from scipy.spatial.transform import Rotation

    placement = imu_placement(robot, header)
    angular = readings[:, :3] @ placement.rotation.T
    turning = central_differences(angular, rate_hz).first
    lever = placement.translation
    about = np.cross(turning, lever) + np.cross(angular, np.cross(angular, lever))
    gravity = Rotation.from_quat(orientation).inv().apply(robot.model.gravity.linear)
    linear = readings[:, 3:] @ placement.rotation.T - about + gravity
    return np.hstack([linear, turning]), angular
