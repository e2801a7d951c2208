"""Rotor inertia, reflected through the gear."""

from __future__ import annotations

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta


class Armature(Effect):
    """``τ = I_a a``: the rotor's inertia times the gear ratio squared, felt by its own joint alone."""

    name = "armature"
    linear = (Parameter("inertia", "kg·m²", 0.0),)
    confusable_with = ("link_inertia", "payload", "joint_elasticity")
    separating_motion = "fast motion of that joint in two postures with different link inertia"
    mujoco = "joint armature"

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: context.a[:, [j]]})
