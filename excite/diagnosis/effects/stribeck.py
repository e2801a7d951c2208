"""Stribeck friction: more friction at low speed."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class Stribeck(Effect):
    """``τ = f_s exp(−(|v|/v_s)²) sign(v)`` (Armstrong-Hélouvry et al. 1994, eq. 3; exponent 2)."""

    name = "stribeck"
    linear = (Parameter("excess", "N·m", 0.0),)
    searched = (Parameter("velocity", "rad/s", 2e-3, 0.6),)
    confusable_with = ("coulomb_friction", "load_dependent_friction", "backlash")
    separating_motion = "constant speeds from below the Stribeck velocity to well above it"
    mujoco = "none of its own: a control callback"

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(v,) for v in (0.01, 0.02, 0.04, 0.08, 0.16, 0.3)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (context.sign(j) * np.exp(-((context.v[:, j] / theta[0]) ** 2)))[:, None]})
