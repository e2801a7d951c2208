"""Friction that grows with the load on the gear."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta


class LoadDependentFriction(Effect):
    """``τ = α |τ_load| sign(v)`` with the predicted load (Hamon, Gautier, Garrec 2010, eq. 9)."""

    name = "load_dependent_friction"
    linear = (Parameter("coefficient", "N·m/(N·m)", 0.0),)
    confusable_with = ("coulomb_friction", "torque_gain", "time_delay")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "none of its own: a control callback"
    friction = True

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (np.abs(context.baseline.rigid[:, j]) * context.sign(j))[:, None]})
