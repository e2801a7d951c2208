"""A joint that sits elsewhere than the model says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.virtual_robot import VirtualRobot

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Shift:
    """A joint moved in its parent's frame.

    Attributes:
        joint: its name.
        by: [m]
    """

    joint: str
    by: tuple[float, float, float]

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Move the body behind the joint."""
        body = spec.joint(self.joint).parent
        body.pos = np.array(body.pos) + np.array(self.by)


class LinkLengthError(InjectedEffect):
    """The joint sits farther along the line from its parent, or along x where the two coincide."""

    name = "link_length_error"
    what = "a joint that sits elsewhere"
    unit = "m"
    lower, upper = -0.5, 0.5

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return () if virtual.robot.floating else virtual.robot.joint_names[1:]

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.03

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        model = virtual.robot.model
        line = model.jointPlacements[model.getJointId(location)].translation
        length = float(np.linalg.norm(line))
        x, y, z = value * (line / length if length > 1e-6 else np.array([1.0, 0.0, 0.0]))
        return virtual.with_change(Shift(location, (float(x), float(y), float(z))))
