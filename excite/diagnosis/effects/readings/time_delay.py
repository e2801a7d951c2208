"""A torque channel that is logged late."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond, Note
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.reversals import told_delay
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

# Less than this share of a sample is a matter of when within it a logger reads its channels.
_SAMPLE = 0.4
# A little of a much longer delay is no delay: it smooths the model's torque, and the encoders' noise in it.
_ALIKE = 1.7
# Standard deviations by which what rows between reversals tell of a delay is another than what all rows tell.
_SURELY = 2.0


@dataclass(frozen=True)
class Late(Note):
    """A torque channel that is logged late: its torque is that of a later time.

    Attributes:
        delay: [s].
    """

    delay: float

    beyond = Beyond.CHANNEL
    every_step = False

    @property
    def late_by(self) -> float:
        return self.delay


def late(baseline: Baseline, delay: float) -> Array:
    """By how much torques that come late, or early where ``delay`` is negative, differ from those predicted.

    ``(n_samples, n_joints)`` [N·m].
    """
    samples, parts = baseline.samples, []
    for trial, torque in zip(samples.trials, samples.split(baseline.total), strict=True):
        parts.append(
            np.column_stack([np.interp(trial.time - delay, trial.time, column) for column in torque.T])
        )
    return np.concatenate(parts) - baseline.total


class TimeDelay(Effect):
    """``τ_logged(t) = τ(t − d)``, on the model's side: filtering the measurement would fake an improvement.

    The column is the secant ``(τ̂(t − d) − τ̂(t))/d`` of the predicted torque.
    """

    name = "time_delay"
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("delay", "s", 0.0, 0.15),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("secant", "s", 4e-4, 0.15),)
    confusable_with = ("actuator_lag", "viscous_friction", "load_dependent_friction")
    separating_motion = "a chirp to some hertz"
    mujoco = "actuator delay (a ring buffer in the control callback)"
    timing = True
    of_channel = True
    stands_in = True
    note = Late

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def grid(self, context: Context, location: str) -> list[Theta]:
        grid = (0.0007, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.09)
        # Bristles would take what is left of a delay between two of these, and keep it.
        late = context.baseline.late
        return [(d,) for d in (grid if late == 0.0 else sorted({*grid, late}))]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        column = late(context.baseline, theta[0]) / theta[0]
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        least = _SAMPLE / context.baseline.samples.rate_hz
        same = theta[0] / _ALIKE <= beta[0] <= theta[0] * _ALIKE
        return same and beta[0] >= least and super().admissible(context, location, theta, beta)

    @property
    def closer(self) -> Effect | None:
        return WholeDelay()

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))


class WholeDelay(TimeDelay):
    """The same, all of the torque late by what is searched: a secant of free size leans on longer, smoother delays."""

    linear: ClassVar[tuple[Parameter, ...]] = ()
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("delay", "s", 4e-4, 0.15),)

    stands_in = False
    proportional = "delay"

    @property
    def closer(self) -> Effect | None:
        return None

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        columns = super().shape(context, location, theta).columns
        return Shape(offset={j: theta[0] * block[:, 0] for j, block in columns.items()})

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """Its length as rows between reversals tell it, where they surely tell another than all rows do; else that."""
        found = super().estimates(context, location, theta, fit)
        told = told_delay(context.baseline.updated(fit), theta[0], late)
        if told is None:
            return found
        off = abs(told.size - theta[0])
        if off > _SURELY * told.std:
            return found | {"delay": Estimate(told.size, told.std, "s")}
        # Where they agree, all rows may still be off by what these cannot tell.
        return found | {"delay": Estimate(theta[0], float(np.hypot(off, told.std)), "s")}

    def sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        value = self.estimates(context, location, theta, fit)["delay"].value
        return super().sizes(context, location, theta, fit) | {"delay": value}
