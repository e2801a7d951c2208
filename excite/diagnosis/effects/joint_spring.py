"""A spring at a joint: cable, hose, gravity compensator."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta
from excite.robot.robot import Array

# A spring whose torque hardly changes over the joint's motion is a constant.
_CHANGES = 0.05


class JointSpring(Effect):
    """``τ = k q + τ_0``: stiffness and the torque at zero position."""

    name = "joint_spring"
    linear = (Parameter("stiffness", "N·m/rad"), Parameter("torque_at_zero", "N·m"))
    confusable_with = ("torque_bias", "encoder_offset", "base_tilt")
    separating_motion = "the joint slowly over its whole range, in two postures of the others"
    mujoco = "joint stiffness and springref"

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        q = context.q[:, j]
        return Shape({j: np.column_stack([q, np.ones_like(q)])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        q = context.q[:, context.row(location)]
        constant = abs(beta[0] * q.mean() + beta[1])
        return abs(beta[0]) * q.std() >= _CHANGES * constant and super().admissible(
            context, location, theta, beta
        )
