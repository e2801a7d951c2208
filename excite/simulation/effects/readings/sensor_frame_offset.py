"""A wrench sensor that does not sit as declared."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class Misplaced:
    """A sensor whose true frame is the declared one, turned by ``rotation`` and moved by ``shift`` in it.

    Attributes:
        sensor: its name.
        rotation: rotation vector [rad].
        shift: [m]
    """

    sensor: str
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, recording: Recording) -> Recording:
        """The recording as read in the true frame."""
        wrench, turn = recording.wrenches[self.sensor], pin.exp3(np.array(self.rotation))
        moment = wrench[:, 3:] - np.cross(np.array(self.shift), wrench[:, :3])
        read = np.hstack([wrench[:, :3] @ turn, moment @ turn])
        return replace(recording, wrenches={**recording.wrenches, self.sensor: read})


class SensorFrameOffset(InjectedEffect):
    """A sensor turned about its x axis."""

    name = "sensor_frame_offset"
    what = "a wrench sensor that is turned against its declared frame"
    unit = "rad"
    lower, upper = -1.0, 1.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(sensor.name for sensor in virtual.robot.sensors)

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.03

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(Misplaced(location, (value, 0.0, 0.0)))
