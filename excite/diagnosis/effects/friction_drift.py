"""Friction that changes over the session, with temperature."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta
from excite.diagnosis.equations import Fit
from excite.diagnosis.result import Estimate


class FrictionDrift(Effect):
    """``τ = g(t) (d_c sign(v) + d_v v)``: Coulomb and viscous friction that change as g from 0 to 1.

    g is ``1 − exp(−t/T)`` scaled to 1 at the session's end (Newton's heating of a joint under a constant
    load); large T is a drift linear in time.
    """

    name = "friction_drift"
    linear = (Parameter("coulomb_change", "N·m"), Parameter("viscous_change", "N·m·s/rad"))
    searched = (Parameter("time_constant", "s", 5.0, 3000.0),)
    confusable_with = ("coulomb_friction", "viscous_friction")
    separating_motion = "the same trial at the start, in the middle and at the end of the session"
    mujoco = "none: a constant at the session's end"
    friction = True

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled and bool({"coulomb_friction", "viscous_friction"} & set(modelled))

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (12.0, 50.0, 2000.0)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        end = float(context.session.max())
        growth = np.expm1(-context.session / theta[0]) / np.expm1(-end / theta[0])
        # What the baseline has not cannot have drifted: a viscous column would stand in for viscous friction.
        modelled = context.baseline.modelled
        coulomb = growth * context.sign(j) if "coulomb_friction" in modelled else np.zeros_like(growth)
        viscous = growth * context.v[:, j] if "viscous_friction" in modelled else np.zeros_like(growth)
        return Shape({j: np.column_stack([coulomb, viscous])})

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        found = super().estimates(context, location, theta, fit)
        if "coulomb_friction" not in context.baseline.modelled:
            return found
        own = fit.own[context.row(location)]
        level = float(own[1 if "viscous_friction" in context.baseline.modelled else 0])
        if level <= 0.0:
            return found
        share = Estimate(float(fit.extra[0]) / level, float(fit.extra_std[0]) / level, "1")
        return {"relative_change": share, **found}
