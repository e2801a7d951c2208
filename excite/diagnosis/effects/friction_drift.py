"""Friction that changes over the session, with temperature."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class FrictionDrift(Effect):
    """``τ = d · g(t) · f(v)``: the friction f at the start, changed by a share d that follows g.

    g is ``1 − exp(−t/T)`` scaled to 1 at the session's end (Newton's heating of a joint under a constant
    load); large T is a drift linear in time.
    """

    name = "friction_drift"
    linear = (Parameter("change", "1", -1.5, 4.0),)
    searched = (Parameter("time_constant", "s", 5.0, 3000.0),)
    confusable_with = ("coulomb_friction", "viscous_friction")
    separating_motion = "the same trial at the start, in the middle and at the end of the session"
    mujoco = "none: a constant at the session's end"

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (10.0, 40.0, 150.0, 2000.0)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        end = float(context.session.max())
        growth = np.expm1(-context.session / theta[0]) / np.expm1(-end / theta[0])
        friction = context.baseline.total[:, j] - context.baseline.rigid[:, j]
        return Shape({j: (growth * friction)[:, None]})
