"""An encoder whose zero is off."""

from __future__ import annotations

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class EncoderOffset(Effect):
    """Logged position = true position + offset: ``τ(q − o) ≈ τ(q) − ∂τ/∂q o`` in all rows."""

    name = "encoder_offset"
    linear = (Parameter("offset", "rad", -0.5, 0.5),)
    confusable_with = ("torque_bias", "base_tilt", "joint_spring")
    separating_motion = "elbow up and elbow down"
    mujoco = "joint ref"
    moves = True

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        gradient = context.gradient(context.row(location), "q")
        return Shape({k: -gradient[:, [k]] for k in range(gradient.shape[1])})
