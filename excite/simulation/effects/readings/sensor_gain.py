"""A wrong scale of one axis of a wrench sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.logs.columns import WRENCH_AXES
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class _Reading:
    sensor: str
    axis: int
    gain: float

    def __call__(self, recording: Recording) -> Recording:
        wrench = recording.wrenches[self.sensor].copy()
        wrench[:, self.axis] *= self.gain
        return replace(recording, wrenches={**recording.wrenches, self.sensor: wrench})


class SensorGain(InjectedEffect):
    """Logged = gain × true for one axis (``SENSOR.AXIS``)."""

    name = "sensor_gain"
    what = "a wrong scale of one axis of a wrench sensor"
    unit = "1"
    lower, upper = 0.01, 100.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(f"{s.name}.{axis}" for s in virtual.robot.sensors for axis in reversed(WRENCH_AXES[:3]))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 1.05

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        sensor, axis = location.split(".")
        return virtual.with_reading(_Reading(sensor, WRENCH_AXES.index(axis), value))
