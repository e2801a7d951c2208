"""What ``robot.yaml`` says of a robot's sensors."""

from __future__ import annotations

from typing import Literal

from excite.robot.per_joint import Block, Name, Source, TorqueNoises
from excite.robot.quantities import Noise, Rate, Rotation3, Vector3


class WrenchSensorBlock(Block):
    """A force-torque sensor in an ankle (``foot_ft``) or a plate in the ground (``force_plate``)."""

    name: Name
    kind: Literal["foot_ft", "force_plate"]
    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)
    foot: str
    excludes: tuple[str, ...] = ()
    noise_force: Noise
    noise_moment: Noise


class ImuBlock(Block):
    """An inertial measurement unit: its link, and the noise of each axis [rad/s, m/s²]."""

    link: str
    noise_gyro: Noise
    noise_acceleration: Noise


class SensorsBlock(Block):
    """What the robot measures, how often and how well (standard deviations of white noise).

    A base that is free needs ``wrench`` sensors in or under its feet, or ``joint_torque``: without the former the
    contact wrenches are unknown and are taken out of the equations.
    """

    rate_hz: Rate
    noise_position: Noise
    joint_torque: Literal["link_side", "motor_side"] | None = None
    noise_torque: TorqueNoises | None = None
    noise_base_position: Noise = 0.0
    noise_base_orientation: Noise = 0.0
    wrench: tuple[WrenchSensorBlock, ...] = ()
    imu: ImuBlock | None = None
    source: Source
