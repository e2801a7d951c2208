"""A constant added to a torque channel."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import CONSTANT, COULOMB, coulomb_level
from excite.doctor.doubt import Doubt

_ASYMMETRY = "coulomb_asymmetry"
# Where friction differs between directions, half the difference is no more than its level; a fit is off by a little.
_OF_LEVEL = 1.1


class TorqueBias(Effect):
    """``τ_logged = τ + b``."""

    name = "torque_bias"
    told_by = frozenset({Doubt.GRAVITY})
    linear = (Parameter("bias", "N·m"),)
    confusable_with = ("coulomb_asymmetry", "encoder_offset", "base_tilt", "joint_spring")
    separating_motion = "a reading at zero torque"
    mujoco = "added to the actuator's force"
    by_motion = True
    term = CONSTANT
    spans = ("1",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: np.ones((len(context.v), 1))})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(bias=item.value("bias"))

    def second_name(self, baseline: Baseline, location: str, fit: Fit) -> str | None:
        """No larger than the Coulomb level, it may be friction that differs between directions."""
        if not COULOMB.asked(baseline.modelled):
            return None
        own = baseline.fit.own[baseline.samples.joints.index(location)]
        level = abs(coulomb_level(baseline.modelled, own))
        return _ASYMMETRY if abs(float(fit.extra[0])) <= _OF_LEVEL * level else None
