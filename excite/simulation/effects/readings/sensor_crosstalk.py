"""A wrench sensor's axis that another axis leaks into."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.logs.columns import WRENCH_AXES
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class _Reading:
    sensor: str
    source: int
    target: int
    share: float

    def __call__(self, recording: Recording) -> Recording:
        wrench = recording.wrenches[self.sensor].copy()
        wrench[:, self.target] += self.share * wrench[:, self.source]
        return replace(recording, wrenches={**recording.wrenches, self.sensor: wrench})


class SensorCrosstalk(InjectedEffect):
    """A share of one force axis appears in another (``SENSOR.AXIS->AXIS``)."""

    name = "sensor_crosstalk"
    what = "one axis of a wrench sensor that leaks into another"
    unit = "1"
    lower, upper = -1.0, 1.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        forces = tuple(reversed(WRENCH_AXES[:3]))
        pairs = [(a, b) for a in forces for b in forces if a != b]
        return tuple(f"{sensor.name}.{a}->{b}" for sensor in virtual.robot.sensors for a, b in pairs)

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.05

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        sensor, axes = location.split(".")
        source, target = (WRENCH_AXES.index(axis) for axis in axes.split("->"))
        return virtual.with_reading(_Reading(sensor, source, target, value))
