"""Encoder offsets where the servo's own reading counts: of the encoder that it follows, or of the log alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.readings.encoder_offset import EncoderOffset
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.servo.servo import Servo
from excite.regressor.kernels import inverse_dynamics

_SMALL = 2e-3


class LoggedOffset(EncoderOffset):
    """Logged position = true position + offset o, and the servo knows the true one.

    The torque that it is taken to ask for then lacks ``kp o``, which soon is more than all that the joint carries,
    and where gravity is fed forward at the measured position, that is taken at the wrong one.

    Args:
        kp: by joint [N·m/rad].
        feedforward: of the servo.
    """

    def __init__(self, kp: Mapping[str, float], feedforward: str):
        self._kp = dict(kp)
        self._weighs = feedforward == "gravity"

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, columns = context.row(location), super().shape(context, location, theta).columns
        columns = {k: column.copy() for k, column in columns.items()}
        columns[j] -= self._kp[location]
        if self._weighs:
            for k, change in enumerate(self._gravity(context, j, math.log(theta[0])).T):
                columns[k][:, 0] += change
        return Shape(columns)

    def _gravity(self, context: Context, j: int, secant: float) -> Array:
        """Change of the nominal weight from the true to the logged position, per offset, ``(n_samples, n_joints)``."""
        samples = context.baseline.samples
        step = secant if abs(secant) > _SMALL else _SMALL
        here = samples.stacked("q")
        there = here.copy()
        there[:, samples.index[j]] -= step
        still = np.zeros((len(here), samples.robot.model.nv))
        old, new = (inverse_dynamics(samples.robot.model, q, still, still) for q in (here, there))
        return np.asarray((old - new)[:, list(samples.index)] / step)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        found = super().estimates(context, location, theta, fit)
        return found | {"in_log_only": found["offset"]}

    def in_mujoco(self, item: Sizes) -> Form:
        return replace(super().in_mujoco(item), notes=(self.noted(item),))


class FollowedOffset(EncoderOffset):
    """An offset that the servo follows; one of the log alone is another form of it."""

    def __init__(self, kp: Mapping[str, float], feedforward: str):
        self._logged = LoggedOffset(kp, feedforward)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (self._logged,)


def servo_effects(servo: Servo, joints: tuple[str, ...]) -> tuple[Effect, ...]:
    """The library of effects as a servo's log shows them.

    Args:
        servo: the servo.
        joints: of the log, in the servo's order.
    """
    kp = dict(zip(joints, servo.kp.tolist(), strict=True))
    followed = FollowedOffset(kp, servo.feedforward)
    return tuple((EFFECTS | {followed.name: followed}).values())
