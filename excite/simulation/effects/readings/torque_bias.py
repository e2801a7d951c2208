"""A constant error of a joint's torque sensor (logged = delivered + bias)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class _Reading:
    joint: int
    value: float

    def __call__(self, recording: Recording) -> Recording:
        motor, link = recording.tau_motor.copy(), recording.tau_link.copy()
        for torque in (motor, link):
            column = torque[:, self.joint]
            torque[:, self.joint] = column + self.value
        return replace(recording, tau_motor=motor, tau_link=link)


class TorqueBias(InjectedEffect):
    """Logged = delivered + bias for one joint; the robot itself is as it was."""

    name = "torque_bias"
    what = "a constant error of a joint's torque sensor"
    unit = "N·m"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        measured = virtual.robot.description.sensors.joint_torque is not None
        return virtual.robot.joint_names if measured else ()

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.02 * float(virtual.drives.torque_limit[virtual.robot.joint_index(location)])

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(_Reading(virtual.robot.joint_index(location), value))
