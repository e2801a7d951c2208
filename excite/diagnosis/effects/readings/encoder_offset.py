"""An encoder whose zero is off."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.effects.note import Beyond, Note
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

_WIDEST = 0.3
_SMALL = 2e-3


@dataclass(frozen=True)
class LoggedAlone(Note):
    """An offset of the log's positions that the servo does not have.

    Attributes:
        in_log_only: the offset [rad].
    """

    in_log_only: float

    beyond = Beyond.READING
    every_step = False

    @property
    def log_offset(self) -> float:
        return self.in_log_only


class EncoderOffset(Effect):
    """Logged position = true position + offset o: ``τ(q − o) − τ(q)`` in all rows.

    The column is the secant ``(τ(q − s) − τ(q))/s``, exact where s is the offset itself; the search moves on
    a logarithmic scale, so that its parameter is ``exp s``.
    """

    name = "encoder_offset"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear = (Parameter("offset", "rad", -0.5, 0.5),)
    searched = (Parameter("secant", "1", math.exp(-_WIDEST), math.exp(_WIDEST)),)
    confusable_with = ("torque_bias", "base_tilt", "joint_spring")
    separating_motion = "elbow up and elbow down"
    mujoco = "joint ref"
    moves = True
    by_motion = True
    note = LoggedAlone

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(1.0,)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, secant = context.row(location), math.log(theta[0])
        if abs(secant) < _SMALL:
            columns = -context.gradient(j, "q")
        else:
            samples = context.baseline.samples
            q = samples.stacked("q").copy()
            q[:, samples.index[j]] -= secant
            moved = context.torques(q, samples.stacked("v"), samples.stacked("a"))
            columns = (moved - (context.baseline.rigid - context.baseline.added)) / secant
        return Shape({k: columns[:, [k]] for k in range(columns.shape[1])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        # A secant much wider than the offset is another function: with 0.3 rad for 0.017 one fits constants of a drive.
        secant, offset = math.log(theta[0]), float(beta[0])
        near = abs(secant - offset) <= abs(offset) + _SMALL
        return near and super().admissible(context, location, theta, beta)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        value, std = float(fit.extra[0]), float(fit.extra_std[0])
        return {"offset": Estimate(value, std if np.isfinite(std) else None, "rad")}

    def in_mujoco(self, item: Sizes) -> Form:
        def turned(draft: Draft) -> None:
            draft.joint(item.location).ref = item.value("offset")

        return Form(elements=turned)
