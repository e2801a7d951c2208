"""Friction that falls with speed before it rises."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.forces.joint_torque import JointTorqueEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class StribeckLaw:
    """``excess · exp(−(|v|/velocity)^exponent)`` more dry friction at low speed (Bo, Pavelescu 1982).

    Attributes:
        joint: index of the joint.
        excess: static less Coulomb friction [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: between 0.5 and 2.
    """

    joint: int
    excess: float
    velocity: float
    exponent: float = 2.0

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        j, i = self.joint, int(plant.joint_dof[self.joint])

        def step() -> None:
            speed = abs(plant.data.qvel[i]) / self.velocity
            plant.friction[j] += self.excess * math.exp(-(speed**self.exponent))

        return step


class Stribeck(JointTorqueEffect):
    """Boundary lubrication that gives way to a film; Stribeck velocity 0.1 rad/s."""

    name = "stribeck"
    what = "more dry friction at low speed"
    unit = "N·m"
    lower, upper = 0.0, 1e4

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(StribeckLaw(virtual.robot.joint_index(location), value, 0.1))
