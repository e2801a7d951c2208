"""A torque channel with a wrong factor."""

from __future__ import annotations

from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt


class TorqueGain(Effect):
    """``τ_logged = g τ``; the column is the predicted torque, the parameter ``g − 1``."""

    name = "torque_gain"
    told_by = frozenset({Doubt.CLOCK, Doubt.SIZE})
    linear = (Parameter("gain_error", "1", -0.7, 2.0),)
    confusable_with = ("payload", "link_inertia", "load_dependent_friction")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "actuator gear"
    by_load = True
    twins_of_a_gain = ("payload",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: context.baseline.total[:, [j]]})

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        error = super().estimates(context, location, theta, fit)
        std = error["gain_error"].std
        return {"gain": Estimate(1.0 + error["gain_error"].value, std, "1"), **error}

    def in_mujoco(self, item: Sizes) -> Form:
        gain = 1.0 + item.value("gain_error")

        def weaker(draft: Draft) -> None:
            motor = draft.motor(item.location)
            motor.gainprm[0] /= gain
            motor.biasprm[0] /= gain

        return Form(reads=gain, elements=weaker)
