"""A gear that gives: a second joint between rotor and link, soft or loose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from excite.simulation.plant import Plant

if TYPE_CHECKING:
    import mujoco

_SUFFIX = ".deflection"


@dataclass(frozen=True)
class LooseGear:
    """Splits a joint into the motor's and the deflection of the link behind it.

    Attributes:
        joint: name of the joint.
        rotor: inertia of the rotor where the drive has none [kg·m²].
    """

    joint: str
    rotor: float

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Add the joint."""
        motor = spec.joint(self.joint)
        if motor.armature <= 0.0:
            motor.armature = self.rotor
        motor.parent.add_joint(
            name=self.joint + _SUFFIX, type=motor.type, axis=motor.axis.copy(), pos=motor.pos.copy()
        )


@dataclass(frozen=True)
class GearLaw:
    """Torque across the gear: a dead band of ±half_gap, then a spring that may harden, and a damper.

    Attributes:
        joint: name of the joint.
        stiffness: beyond the dead band [N·m/rad].
        damping: [N·m·s/rad], within the dead band none.
        half_gap: half the play [rad].
        hardening: relative growth of the stiffness with the square of the deflection [1/rad²].
    """

    joint: str
    stiffness: float
    damping: float
    half_gap: float = 0.0
    hardening: float = 0.0

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        joint = plant.model.joint(self.joint + _SUFFIX)
        at, i = int(joint.qposadr[0]), int(joint.dofadr[0])

        def step() -> None:
            x = float(plant.data.qpos[at])
            beyond = x - self.half_gap if x > self.half_gap else min(x + self.half_gap, 0.0)
            if not beyond:
                return
            spring = self.stiffness * beyond * (1.0 + self.hardening * beyond * beyond)
            pull = spring + self.damping * float(plant.data.qvel[i])
            # A contact pushes and does not pull.
            if self.half_gap and pull * beyond < 0.0:
                pull = 0.0
            plant.torque[i] -= pull

        return step
