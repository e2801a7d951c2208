"""Stribeck friction: more friction at low speed."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta
from excite.robot.robot import Array

# A Stribeck velocity nearer to the width of the sign change says how friction changes sign, no more.
_APART = 2.5


class Stribeck(Effect):
    """``τ = f_s exp(−(|v|/v_s)²) sign(v)`` (Armstrong-Hélouvry et al. 1994, eq. 3; exponent 2)."""

    name = "stribeck"
    linear = (Parameter("excess", "N·m", 0.0),)
    searched = (Parameter("velocity", "rad/s", 5e-3, 0.5),)
    confusable_with = ("coulomb_friction", "load_dependent_friction", "backlash")
    separating_motion = "constant speeds from below the Stribeck velocity to well above it"
    mujoco = "none of its own: a control callback"
    friction = True

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(v,) for v in (0.015, 0.03, 0.06, 0.12, 0.25)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (context.sign(j) * np.exp(-((context.v[:, j] / theta[0]) ** 2)))[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        width = float(context.baseline.widths[context.row(location)])
        return theta[0] >= _APART * width and super().admissible(context, location, theta, beta)
