"""Coulomb friction: a torque against the velocity whatever its size."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.baseline import WIDTHS
from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class CoulombFriction(Effect):
    """``τ = f_c sign(v)``, the sign smoothed over a width that is searched (Armstrong-Hélouvry et al. 1994)."""

    name = "coulomb_friction"
    linear = (Parameter("level", "N·m", 0.0),)
    searched = (Parameter("width", "rad/s", 5e-4, 0.1),)
    confusable_with = ("stribeck", "load_dependent_friction", "viscous_friction")
    separating_motion = "slow reversals at constant speed"
    mujoco = "joint frictionloss"

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w,) for w in WIDTHS]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: np.tanh(context.v[:, [j]] / theta[0])})
