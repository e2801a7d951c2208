"""Dry friction with bristles that bend before they slip."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.plant import Plant


@dataclass(frozen=True)
class BristleLaw:
    """The LuGre model in place of a joint's dry friction (Canudas de Wit et al. 1995, eqs. 1 to 5).

    Attributes:
        joint: index of the joint.
        level: Coulomb friction [N·m]; the drive's own is replaced.
        excess: static less Coulomb friction [N·m].
        velocity: Stribeck velocity [rad/s].
        breakaway: deflection of the bristles at which they slip [rad].
    """

    joint: int
    level: float
    excess: float = 0.0
    velocity: float = 0.1
    breakaway: float = 2e-3

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        j, i = self.joint, int(plant.joint_dof[self.joint])
        h = float(plant.model.opt.timestep)
        inertia = max(float(plant.drives.armature[j]), 1e-3)
        stiffness = self.level / self.breakaway
        stiffness = min(stiffness, 0.1 * inertia / h**2)
        damping = math.sqrt(stiffness * inertia)
        z = 0.0

        def step() -> None:
            nonlocal z
            v = float(plant.data.qvel[i])
            slip = self.level + self.excess * math.exp(-((v / self.velocity) ** 2))
            new = (z + h * v) / (1.0 + h * stiffness * abs(v) / slip)
            rate, z = (new - z) / h, new
            # Damping of the bristles dies out with speed, or sliding would be viscous.
            force = stiffness * z + damping * rate * math.exp(-((v / 0.05) ** 2))
            plant.friction[j] -= float(plant.drives.total_coulomb[j])
            plant.torque[i] -= force

        return step
