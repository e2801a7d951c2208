"""What soft gears and loose ones have in common: the link behind them moves otherwise than the motor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import TYPE_CHECKING

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import DEFLECTION, Draft, Told
from excite.diagnosis.effects.gears.deflection import added_torque, deflect
from excite.diagnosis.effects.gears.gear import Behind, Gear
from excite.diagnosis.effects.gears.gear_start import first_states

if TYPE_CHECKING:
    import mujoco

# A motor whose rotor weighs nothing has no equation of motion of its own [kg·m²].
_LEAST_ROTOR = 1e-4


class GearEffect(Effect, ABC):
    """An effect of a gear that gives way.

    Attributes:
        second_order: whether torques follow the deflection to second order, instead of to first.
    """

    moves = True
    second_order: bool = False

    @property
    def closer(self) -> Effect | None:
        """To second order: a gear that is soft for its load turns gravity with it."""
        if self.second_order:
            return None
        other = copy(self)
        other.second_order = True
        return other

    @abstractmethod
    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        """The gear that non-linear parameters stand for."""

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        """What the link's deflection from the motor adds to the torques of all joints.

        ``∂τ/∂q δ + ∂τ/∂v δ̇ + M δ̈`` and so on in the deflection δ, with δ from its own equation of motion, the other
        joints moving as logged (Spong 1987, eq. 5, with the motor's side prescribed).
        """
        j = context.row(location)
        moved = self.deflection(context, location, theta)
        by_q, by_v, mass = (context.gradient(j, what) for what in ("q", "v", "a"))
        if self.second_order:
            x, s = moved[0][:, None], moved[1][:, None]
            qq, qv, vv, qa = (context.curvature(j, what) for what in ("qq", "qv", "vv", "qa"))
            by_q, by_v, mass = by_q + 0.5 * qq * x, by_v + qv * x + 0.5 * vv * s, mass + qa * x
        return Shape(offset=dict(enumerate(added_torque(by_q, by_v, mass, moved))))

    def deflection(self, context: Context, location: str, theta: Theta) -> Array:
        """The link's angle less the motor's, its speed and its acceleration, the rows of ``(3, n_samples)``."""
        j, samples = context.row(location), context.baseline.samples
        behind = Behind.joint(context, j, second_order=self.second_order)
        gear = self.gear(context, location, theta)
        begin = first_states(context, j, behind, gear)
        return deflect(behind, gear, samples.starts, begin, 1.0 / samples.rate_hz)

    def told(self, context: Context, location: str, theta: Theta) -> Told:
        moved = self.deflection(context, location, theta)
        return Told(deflection=context.baseline.samples.split(moved[:2].T))


def joint_behind(draft: Draft, motor: str) -> mujoco.MjsJoint:
    """A second joint of the body that a motor moves, behind the motor's, whose rotor alone the armature then is."""
    joint = draft.joint(motor)
    joint.armature = max(joint.armature, _LEAST_ROTOR)
    return draft.moved_body(motor).add_joint(name=motor + DEFLECTION, type=joint.type, axis=joint.axis)
