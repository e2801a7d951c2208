"""A torque channel with a wrong factor."""

from __future__ import annotations

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class TorqueGain(Effect):
    """``τ_logged = g τ``; the column is the predicted torque, the parameter ``g − 1``."""

    name = "torque_gain"
    linear = (Parameter("gain_error", "1", -0.7, 2.0),)
    confusable_with = ("payload", "link_inertia", "load_dependent_friction")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "actuator gear"

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: context.baseline.total[:, [j]]})
