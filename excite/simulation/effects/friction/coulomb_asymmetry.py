"""Coulomb friction that differs between the directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class AsymmetryLaw:
    """Friction is larger by ``change`` in the positive direction and smaller by it in the other.

    Attributes:
        joint: index of the joint.
        change: half the difference between the directions [N·m].
    """

    joint: int
    change: float

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        j, i = self.joint, int(plant.joint_dof[self.joint])

        def step() -> None:
            plant.friction[j] += self.change if plant.data.qvel[i] > 0.0 else -self.change

        return step


class CoulombAsymmetry(InjectedEffect):
    """Gears whose teeth carry differently on their two flanks."""

    name = "coulomb_asymmetry"
    what = "Coulomb friction that differs between the directions"
    unit = "N·m"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.5 * float(virtual.drives.total_coulomb[virtual.robot.joint_index(location)])

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(AsymmetryLaw(virtual.robot.joint_index(location), value))
