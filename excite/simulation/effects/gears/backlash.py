"""Play in a gear of the virtual robot, to be injected."""

from __future__ import annotations

import math

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.effects.gears.gear import GearLaw, LooseGear
from excite.simulation.true_parameters import moved_inertia
from excite.simulation.virtual_robot import VirtualRobot


class Backlash(InjectedEffect):
    """The link flies freely between two flanks; on either it sits on a spring of 25 Hz."""

    name = "backlash"
    what = "play in a gear"
    unit = "rad"
    lower, upper = 0.0, 0.5

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.015

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        inertia = moved_inertia(virtual.robot, location)
        stiffness = inertia * (2.0 * math.pi * 25.0) ** 2
        law = GearLaw(location, stiffness, math.sqrt(stiffness * inertia), 0.5 * value)
        return virtual.with_change(LooseGear(location, 0.3 * inertia)).with_law(law)
