"""A wrong scale of a joint's torque sensor (logged = gain × delivered)."""

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
            torque[:, self.joint] = column * self.value
        return replace(recording, tau_motor=motor, tau_link=link)


class TorqueGain(InjectedEffect):
    """Logged = gain × delivered for one joint; the robot itself is as it was."""

    name = "torque_gain"
    what = "a wrong scale of a joint's torque sensor"
    unit = "1"
    lower, upper = 0.01, 100.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        measured = virtual.robot.description.sensors.joint_torque is not None
        return virtual.robot.joint_names if measured else ()

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 1.1

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(_Reading(virtual.robot.joint_index(location), value))
