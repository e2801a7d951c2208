"""Dry friction that grows with the load on the gear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class LoadFrictionLaw:
    """``coefficient · |torque that the gear carries|`` more dry friction.

    Attributes:
        joint: index of the joint.
        coefficient: of sliding between teeth, as felt at the joint.
    """

    joint: int
    coefficient: float

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        j = self.joint

        def step() -> None:
            plant.friction[j] += self.coefficient * abs(plant.load(j))

        return step


class LoadDependentFriction(InjectedEffect):
    """Teeth that are pressed together rub."""

    name = "load_dependent_friction"
    what = "dry friction proportional to the load on the gear"
    unit = "1"
    lower, upper = 0.0, 0.9

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.1

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(LoadFrictionLaw(virtual.robot.joint_index(location), value))
