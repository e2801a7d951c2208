"""A channel that is logged late."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class _Reading:
    channel: str
    delay: float

    def __call__(self, recording: Recording) -> Recording:
        time = recording.time
        if self.channel == "torque":
            return replace(
                recording,
                tau_motor=_late(time, recording.tau_motor, self.delay),
                tau_link=_late(time, recording.tau_link, self.delay),
            )
        late = {name: _late(time, wrench, self.delay) for name, wrench in recording.wrenches.items()}
        return replace(recording, wrenches=late)


def _late(time: Array, values: Array, delay: float) -> Array:
    """``values(time - delay)``, cubic between samples; before the first sample its value holds."""
    from scipy.interpolate import CubicSpline

    shifted = np.maximum(time - delay, time[0])
    return np.asarray(CubicSpline(time, values, axis=0)(shifted))


class TimeDelay(InjectedEffect):
    """reading(t) = true(t - d) for all joint torques, or for all contact wrenches."""

    name = "time_delay"
    what = "a torque or wrench channel that is logged late"
    unit = "s"
    lower, upper = 0.0, 1.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        torque = ("torque",) if virtual.robot.description.sensors.joint_torque is not None else ()
        return (*torque, "wrench") if virtual.robot.sensors else torque

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.02

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(_Reading(location, value))
