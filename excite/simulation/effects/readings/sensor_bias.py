"""A constant that a wrench sensor adds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot

_ARM = 0.1


@dataclass(frozen=True)
class WrenchBias:
    """Logged = true + bias.

    Attributes:
        sensor: its name.
        bias: force [N], then moment [N·m].
    """

    sensor: str
    bias: tuple[float, float, float, float, float, float]

    def __call__(self, recording: Recording) -> Recording:
        """The recording with it."""
        wrench = recording.wrenches[self.sensor] + np.array(self.bias)
        return replace(recording, wrenches={**recording.wrenches, self.sensor: wrench})


class SensorBias(InjectedEffect):
    """The value on each axis of force, and a tenth of it [m] on each of moment."""

    name = "sensor_bias"
    what = "a constant error of a wrench sensor"
    unit = "N"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(sensor.name for sensor in virtual.robot.sensors)

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.02 * 9.81 * virtual.robot.mass

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        moment = _ARM * value
        return virtual.with_reading(WrenchBias(location, (value, value, value, moment, moment, moment)))
