"""Actuators that follow their command with a lag."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.effects.note import Beyond, Note
from excite.doctor.doubt import Doubt

# Less than this share of a sample is a matter of when within it a logger reads its channels.
_SAMPLE = 0.4


@dataclass(frozen=True)
class FasterFilter(Note):
    """The second of two filters in series, before that of the motors.

    Attributes:
        before: its time constant [s].
    """

    before: float

    beyond = Beyond.CHANNEL
    every_step = False

    @property
    def filter_before(self) -> float:
        return self.before


class ActuatorLag(Effect):
    """The log holds the command u, the joints get τ with ``T τ̇ + τ = u``: ``u = τ + T τ̇``, linear in T."""

    name = "actuator_lag"
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("time_constant", "s", 0.0, 0.5),)
    confusable_with = ("time_delay", "viscous_friction")
    separating_motion = "a chirp to 5 … 15 Hz"
    mujoco = "actuator dyntype filter, dynprm"
    timing = True
    late_by = "time_constant"
    note = FasterFilter
    twins_without_torque = ("time_delay",)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (SecondOrderLag(),)

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        parts = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.split(context.baseline.total)]
        column = np.concatenate(parts)
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        least = _SAMPLE / context.baseline.samples.rate_hz
        return beta[0] >= least and super().admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        import mujoco

        slow, fast = self.filters(item)

        def lagging(draft: Draft) -> None:
            for name in draft.joints:
                motor = draft.motor(name)
                motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
                # The filter's at the step's end: a command is half a step old, and so is the velocity of a servo.
                motor.dynprm[0], motor.actearly = slow, True

        notes = () if fast is None else (self.noted(replace(item, values={"before": fast})),)
        return Form(elements=lagging, notes=notes)

    def filters(self, item: Sizes) -> tuple[float, float | None]:
        """Time constants of the motors' filter and of one before it [s]; None where there is no other."""
        return item.value("time_constant"), None


class SecondOrderLag(ActuatorLag):
    """``T₂² τ̈ + T τ̇ + τ = u``: two filters in series."""

    linear = (*ActuatorLag.linear, Parameter("second_order", "s²", 0.0, 0.1))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        first = super().shape(context, location, theta).columns
        stacked = np.column_stack([first[j][:, 0] for j in sorted(first)])
        second = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.split(stacked)]
        rate = np.concatenate(second)
        return Shape({j: np.column_stack([first[j][:, 0], rate[:, j]]) for j in first})

    def filters(self, item: Sizes) -> tuple[float, float | None]:
        """``T₂² τ̈ + T τ̇ + τ = u`` as two filters in series, as like as they can be where it rings."""
        total, square = item.value("time_constant"), item.value("second_order")
        root = float(np.sqrt(max(0.25 * total**2 - square, 0.0)))
        return 0.5 * total + root, 0.5 * total - root if square > 0.0 else None
