"""A logged base orientation that is off by a constant rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class Misaligned:
    """Logged orientation = true orientation, then a rotation in the base's own frame.

    Attributes:
        rotation: rotation vector [rad].
    """

    rotation: tuple[float, float, float]

    def __call__(self, recording: Recording) -> Recording:
        """The recording as logged."""
        turn = pin.Quaternion(pin.exp3(np.array(self.rotation)))
        q = recording.q.copy()
        q[:, 3:7] = [_times(row, turn) for row in recording.q[:, 3:7]]
        return replace(recording, q=q)


def _times(quaternion: Array, turn: pin.Quaternion) -> Array:
    return np.asarray((pin.Quaternion(quaternion) * turn).normalized().coeffs())


class BaseOrientationBias(InjectedEffect):
    """An inertial unit mounted askew: turned about the base's y axis."""

    name = "base_orientation_bias"
    what = "a logged base orientation that is off by a constant rotation"
    unit = "rad"
    lower, upper = -1.0, 1.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return ("base",) if virtual.robot.floating else ()

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.03

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_reading(Misaligned((0.0, value, 0.0)))
