"""Play in a gear."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.deflection import link_inertia, response
from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class Backlash(Effect):
    """The link flies freely through a dead band between two contacts (Nordin, Gutman 2002, section 2)."""

    name = "backlash"
    searched = (Parameter("width", "rad", 2e-4, 0.08), Parameter("contact_hz", "Hz", 4.0, 150.0))
    confusable_with = ("torque_bias", "stribeck", "joint_elasticity")
    separating_motion = "torque crossing zero at constant speed"
    mujoco = "a second joint with limited range behind the motor's"
    moves = True

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w, 20.0) for w in (0.002, 0.004, 0.007, 0.011, 0.016, 0.024, 0.036)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        inertia = float(link_inertia(context, j).mean())
        stiffness = inertia * (2.0 * np.pi * theta[1]) ** 2
        return Shape(offset=response(context, j, stiffness, 1.0, 0.5 * theta[0]))
