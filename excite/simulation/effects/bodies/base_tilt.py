"""A base that does not stand as the model says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.virtual_robot import VirtualRobot

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Tilt:
    """Gravity turned in the base's frame.

    Attributes:
        angle: [rad]
        heading: of the horizontal axis about which it turns [rad].
    """

    angle: float
    heading: float = 0.0

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Turn gravity."""
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        spec.option.gravity = pin.exp3(self.angle * axis) @ np.array(spec.option.gravity)


class BaseTilt(InjectedEffect):
    """An arm on a table that is not level: turned about the x axis."""

    name = "base_tilt"
    what = "a base that is not level"
    unit = "rad"
    lower, upper = -1.0, 1.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return () if virtual.robot.floating else ("base",)

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.05

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_change(Tilt(value))
