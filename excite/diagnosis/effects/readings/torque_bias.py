"""A constant added to a torque channel."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta


class TorqueBias(Effect):
    """``τ_logged = τ + b``."""

    name = "torque_bias"
    linear = (Parameter("bias", "N·m"),)
    confusable_with = ("coulomb_asymmetry", "encoder_offset", "base_tilt", "joint_spring")
    separating_motion = "a reading at zero torque"
    mujoco = "added to the actuator's force"

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return "torque_bias" not in modelled and "coulomb_asymmetry" not in modelled

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: np.ones((len(context.v), 1))})
