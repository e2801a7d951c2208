"""Friction that changes while a joint warms up."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class WarmingLaw:
    """Friction times ``1 + change · T`` with a temperature T that goes from 0 towards 1 over a session.

    Attributes:
        joint: index of the joint.
        change: relative change once warm.
        time_constant: of the warming [s].
        heated: whether the joint's own friction heats it (T' = (power/usual power − T)/time_constant), or time
            alone does.
        viscous_only: whether the oil changes and the dry part stays.
    """

    joint: int
    change: float
    time_constant: float
    heated: bool = False
    viscous_only: bool = False

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        j, i = self.joint, int(plant.joint_dof[self.joint])
        dry, oil = float(plant.drives.total_coulomb[j]), float(plant.drives.total_viscous[j])
        usual = dry * 0.5 + oil * 0.25
        key, step_s = ("temperature", j), float(plant.model.opt.timestep)
        cool = plant.session_s - plant.memory.get((*key, "left"), 0.0)
        state = plant.memory.get(key, 0.0) * math.exp(-max(cool, 0.0) / self.time_constant)

        def step() -> None:
            nonlocal state
            if self.heated:
                v = abs(plant.data.qvel[i])
                state += step_s * ((dry * v + oil * v * v) / usual - state) / self.time_constant
                plant.memory[key] = state
                plant.memory[(*key, "left")] = plant.session_s + plant.time
            else:
                state = -math.expm1(-(plant.session_s + max(plant.time, 0.0)) / self.time_constant)
            factor = self.change * state
            plant.damping[j] += factor * oil
            if not self.viscous_only:
                plant.friction[j] += factor * dry

        return step


class FrictionDrift(InjectedEffect):
    """Warming in a minute; the relative change of a joint's friction once it is warm."""

    name = "friction_drift"
    what = "friction that changes while the joint warms up"
    unit = "1"
    lower, upper = -0.95, 10.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return -0.4

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(WarmingLaw(virtual.robot.joint_index(location), value, 60.0))
