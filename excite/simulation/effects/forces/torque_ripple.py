"""A torque that comes and goes with the rotor's position."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.forces.joint_torque import JointTorqueEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class RippleLaw:
    """``(amplitude + load_share·|load|) (sin(n q + phase) + second·sin(2 n q))`` against the drive.

    Attributes:
        joint: index of the joint.
        amplitude: [N·m]
        periods: a revolution of the joint.
        phase: [rad]
        load_share: part that grows with the load on the gear.
        second: share of the second harmonic.
    """

    joint: int
    amplitude: float
    periods: float
    phase: float = 0.0
    load_share: float = 0.0
    second: float = 0.0

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        at = int(plant.qpos[plant.robot.n_base_q + self.joint])
        i = int(plant.joint_dof[self.joint])

        def step() -> None:
            angle = self.periods * float(plant.data.qpos[at])
            size = self.amplitude
            if self.load_share:
                size += self.load_share * abs(plant.load(self.joint))
            wave = math.sin(angle + self.phase) + self.second * math.sin(2.0 * angle)
            plant.torque[i] -= size * wave

        return step


class TorqueRipple(JointTorqueEffect):
    """Cogging with 24 periods a revolution."""

    name = "torque_ripple"
    what = "a torque periodic in the joint's position"
    unit = "N·m"
    lower, upper = 0.0, 1e4

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(RippleLaw(virtual.robot.joint_index(location), value, 24.0))
