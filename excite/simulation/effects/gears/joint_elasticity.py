"""A soft gear between motor and link."""

from __future__ import annotations

import math

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.effects.gears.gear import GearLaw, LooseGear
from excite.simulation.true_parameters import moved_inertia
from excite.simulation.virtual_robot import VirtualRobot


class JointElasticity(InjectedEffect):
    """The encoder sits on the motor; the link follows through a spring with a tenth of critical damping."""

    name = "joint_elasticity"
    what = "a soft gear between motor and link"
    unit = "N·m/rad"
    lower, upper = 1e-3, 1e7

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return moved_inertia(virtual.robot, location) * (2.0 * math.pi * 4.0) ** 2

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        inertia = moved_inertia(virtual.robot, location)
        damping = 2.0 * 0.1 * math.sqrt(value * inertia)
        return virtual.with_change(LooseGear(location, 0.3 * inertia)).with_law(
            GearLaw(location, value, damping)
        )
