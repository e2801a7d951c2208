"""Rotor inertia, reflected through the gear."""

from __future__ import annotations

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.equations.own_columns import ARMATURE
from excite.doctor.doubt import Doubt


class Armature(Effect):
    """``τ = I_a a``: the rotor's inertia times the gear ratio squared, felt by its own joint alone."""

    name = "armature"
    told_by = frozenset({Doubt.CLOCK})
    linear = (Parameter("inertia", "kg·m²", 0.0),)
    confusable_with = ("link_inertia", "payload", "joint_elasticity")
    separating_motion = "fast motion of that joint in two postures with different link inertia"
    without_motion = "the rotor's inertia by its data sheet times the gear's ratio squared"
    mujoco = "joint armature"
    by_motion = True
    term = ARMATURE
    twins_of_a_gain = ("torque_gain",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: context.a[:, [j]]})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(armature=item.value("inertia"))
