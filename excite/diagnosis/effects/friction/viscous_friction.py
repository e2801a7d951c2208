"""Viscous friction: a torque against the velocity and proportional to it."""

from __future__ import annotations

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.equations.own_columns import VISCOUS
from excite.doctor.doubt import Doubt


class ViscousFriction(Effect):
    """``τ = f_v v`` (Armstrong-Hélouvry, Dupont, Canudas de Wit 1994, section 2.1)."""

    name = "viscous_friction"
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear = (Parameter("coefficient", "N·m·s/rad", 0.0),)
    confusable_with = ("coulomb_friction", "actuator_lag")
    separating_motion = "constant speeds from slow to fast, both ways"
    mujoco = "joint damping"
    by_motion = True
    term = VISCOUS
    twins_of_a_gain = ("torque_gain",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: context.v[:, [j]]})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(viscous=item.value("coefficient"))
