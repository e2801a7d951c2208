"""Effects of readings and drives: gains, biases, offsets, delays, lags."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.effect import SECANT, Belief, Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Absence, Context, Draft, Form, Note, Sizes
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.reversals import estimate_delay
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import CONSTANT, COULOMB, coulomb_level
from excite.doctor.doubt import Doubt

# A torque channel with a wrong factor.


class TorqueGain(Effect):
    """``τ_logged = g τ``; the column is the predicted torque, the parameter ``g − 1``."""

    name = "torque_gain"
    belief = Belief(width=0.3)
    observed_by = frozenset({Doubt.CLOCK, Doubt.SIZE})
    linear = (Parameter("gain_error", "1", -0.7, 2.0),)
    confusable_with = ("payload", "link_inertia", "load_dependent_friction")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "actuator gear"
    by_load = True
    twins_of_a_gain = ("payload",)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return context.baseline.total[:, [context.row(location)]]

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        error = super().to_estimates(context, location, theta, fit)
        std = error["gain_error"].std
        return {"gain": Estimate(1.0 + error["gain_error"].value, std, "1"), **error}

    def in_mujoco(self, item: Sizes) -> Form:
        gain = 1.0 + item.value_of("gain_error")

        def reduce_gain(draft: Draft) -> None:
            motor = draft.find_motor(item.location)
            motor.gainprm[0] /= gain
            motor.biasprm[0] /= gain

        return Form(reads=gain, elements=reduce_gain)


# Actuators that follow their command with a lag.

# Less than this share of a sample is a matter of when within it a logger reads its channels.
_ACTUATOR_LAG_SAMPLE = 0.4


@dataclass(frozen=True)
class LagNote(Note):
    """The second of two filters in series, before that of the motors.

    Attributes:
        before: its time constant [s].
    """

    before: float

    beyond = Absence.CHANNEL
    every_step = False

    @property
    def filter_before(self) -> float:
        return self.before


class ActuatorLag(Effect):
    """The log holds the command u, the joints get τ with ``T τ̇ + τ = u``: ``u = τ + T τ̇``, linear in T."""

    name = "actuator_lag"
    belief = Belief(width=0.03, group="timing")
    observed_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("time_constant", "s", 0.0, 0.5),)
    confusable_with = ("time_delay", "viscous_friction")
    separating_motion = "a chirp to 5 … 15 Hz"
    mujoco = "actuator dyntype filter, dynprm"
    timing = True
    late_by = "time_constant"
    note = LagNote
    twins_without_torque = ("time_delay",)

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (SecondOrderLag(),)

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        parts = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.by_trial(context.baseline.total)]
        column = np.concatenate(parts)
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        least = _ACTUATOR_LAG_SAMPLE / context.baseline.samples.rate_hz
        return beta[0] >= least and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        import mujoco

        slow, fast = self.filter_time_constants(item)

        def add_lag_filter(draft: Draft) -> None:
            for name in draft.joints:
                motor = draft.find_motor(name)
                motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
                # The filter's at the step's end: a command is half a step old, and so is the velocity of a servo.
                motor.dynprm[0], motor.actearly = slow, True

        notes = () if fast is None else (self.make_note(replace(item, values={"before": fast})),)
        return Form(elements=add_lag_filter, notes=notes)

    def filter_time_constants(self, item: Sizes) -> tuple[float, float | None]:
        """Time constants of the motors' filter and of one before it [s]; None where there is no other."""
        return item.value_of("time_constant"), None


class SecondOrderLag(ActuatorLag):
    """``T₂² τ̈ + T τ̇ + τ = u``: two filters in series."""

    linear = (*ActuatorLag.linear, Parameter("second_order", "s²", 0.0, 0.1))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        first = super().shape(context, location, theta).columns
        stacked = np.column_stack([first[j][:, 0] for j in sorted(first)])
        second = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.by_trial(stacked)]
        rate = np.concatenate(second)
        return Shape({j: np.column_stack([first[j][:, 0], rate[:, j]]) for j in first})

    def filter_time_constants(self, item: Sizes) -> tuple[float, float | None]:
        """``T₂² τ̈ + T τ̇ + τ = u`` as two filters in series, as like as they can be where it rings."""
        total, square = item.value_of("time_constant"), item.value_of("second_order")
        root = float(np.sqrt(max(0.25 * total**2 - square, 0.0)))
        return 0.5 * total + root, 0.5 * total - root if square > 0.0 else None


# An encoder whose zero is off.

_WIDEST = 0.3
_SMALL = 2e-3


@dataclass(frozen=True)
class OffsetNote(Note):
    """An offset of the log's positions that the servo does not have.

    Attributes:
        in_log_only: the offset [rad].
    """

    in_log_only: float

    beyond = Absence.READING
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
    belief = Belief(chance=0.04, width=0.05)
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear = (Parameter("offset", "rad", -0.5, 0.5),)
    searched = (Parameter(SECANT, "1", math.exp(-_WIDEST), math.exp(_WIDEST)),)
    confusable_with = ("torque_bias", "base_tilt", "joint_spring")
    separating_motion = "elbow up and elbow down"
    mujoco = "joint ref"
    moves = True
    by_motion = True
    note = OffsetNote

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(1.0,)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, secant = context.row(location), math.log(theta[0])
        if abs(secant) < _SMALL:
            columns = -context.torque_gradient(j, "q")
        else:
            still = context.baseline.rigid - context.baseline.added
            columns = (context.perturbed_torques(j, -secant) - still) / secant
        return Shape({k: columns[:, [k]] for k in range(columns.shape[1])})

    def shape_at(self, theta: Theta, beta: Array) -> Theta:
        return (math.exp(float(np.clip(beta[0], -_WIDEST, _WIDEST))),)

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        # A secant much wider than the offset is another function: with 0.3 rad for 0.017 one fits constants of a drive.
        secant, offset = math.log(theta[0]), float(beta[0])
        near = abs(secant - offset) <= abs(offset) + _SMALL
        return near and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        def shift_reference(draft: Draft) -> None:
            draft.find_joint(item.location).ref = item.value_of("offset")

        return Form(elements=shift_reference)


# A position that is scaled: a gear of another ratio than the one that turns counts into angles.


class PositionGain(Effect):
    """Logged position = g · true position: ``τ(q/g) − τ(q)`` in all rows; the parameter is ``g − 1``.

    The column is the secant over ``s`` with ``1 + s`` for g, exact where s is the error itself.
    """

    name = "position_gain"
    belief = Belief(chance=0.01, width=0.05)
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear = (Parameter("gain_error", "1", -0.5, 1.0),)
    searched = (Parameter(SECANT, "1", 0.5, 2.0),)
    confusable_with = ("encoder_offset", "joint_spring", "link_length_error")
    separating_motion = "the joint over its whole range; a turn of it beside an inclinometer"
    mujoco = "none: the log's positions are divided by it"
    moves = True
    by_motion = True

    def locations(self, context: Context) -> tuple[str, ...]:
        return context.joints if context.baseline.samples.robot.mechanism is None else ()

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(1.0 + _SMALL,)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        base, j = context.baseline, context.row(location)
        gain = self.shape_at(theta, np.array([theta[0] - 1.0]))[0]
        moved = base.samples.rigid_torques(base.phi, base.samples.scaled_motion(j, 1.0 / gain))
        columns = (moved - (base.rigid - base.added)) / (gain - 1.0)
        return Shape({k: columns[:, [k]] for k in range(columns.shape[1])})

    def shape_at(self, theta: Theta, beta: Array) -> Theta:
        error = float(np.clip(beta[0], self.linear[0].low, self.linear[0].high))
        return (1.0 + (error if abs(error) > _SMALL else _SMALL),)

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        near = abs(theta[0] - 1.0 - beta[0]) <= abs(beta[0]) + _SMALL
        return near and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(absent=Absence.READING)


# A torque channel that is logged late.

# Less than this share of a sample is a matter of when within it a logger reads its channels.
_SAMPLE = 0.4
# A little of a much longer delay is no delay: it smooths the model's torque, and the encoders' noise in it.
_ALIKE = 1.7
# Standard deviations by which what rows between reversals tell of a delay is another than what all rows tell.
_SURELY = 2.0


@dataclass(frozen=True)
class DelayNote(Note):
    """A torque channel that is logged late: its torque is that of a later time.

    Attributes:
        delay: [s].
    """

    delay: float

    beyond = Absence.CHANNEL
    every_step = False

    @property
    def late_by(self) -> float:
        return self.delay


def delay_change(baseline: Baseline, delay: float) -> Array:
    """By how much torques that come late, or early where ``delay`` is negative, differ from those predicted.

    ``(n_samples, n_joints)`` [N·m].
    """
    samples, parts = baseline.samples, []
    for trial, torque in zip(samples.trials, samples.by_trial(baseline.total), strict=True):
        parts.append(
            np.column_stack([np.interp(trial.time - delay, trial.time, column) for column in torque.T])
        )
    return np.concatenate(parts) - baseline.total


def _logged_change(baseline: Baseline, delay: float) -> Array:
    """By how much the log's torques a while later differ from those now, ``(n_samples, n_joints)`` [N·m].

    Cubic splines leave the power of the noise in the rows' band; lines between samples would take a part of it.
    """
    parts = []
    for trial in baseline.samples.trials:
        later = np.minimum(trial.time + delay, trial.time[-1])
        parts.append(trial.torque_spline(later) - trial.measured_torque)
    return np.concatenate(parts)


class TimeDelay(Effect):
    """``τ_logged(t) = τ(t − d)``.

    The column is the secant ``(τ̂(t − d) − τ̂(t))/d`` of the predicted torque.
    """

    name = "time_delay"
    belief = Belief(group="timing")
    observed_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("delay", "s", 0.0, 0.15),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter(SECANT, "s", 4e-4, 0.15),)
    confusable_with = ("actuator_lag", "viscous_friction", "load_dependent_friction")
    separating_motion = "a chirp to some hertz"
    mujoco = "actuator delay (a ring buffer in the control callback)"
    timing = True
    of_channel = True
    stands_in = True
    note = DelayNote

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        grid = (0.0007, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.09)
        # Bristles would take what is left of a delay between two of these, and keep it.
        late = context.baseline.late
        return [(d,) for d in (grid if late == 0.0 else sorted({*grid, late}))]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        column = delay_change(context.baseline, theta[0]) / theta[0]
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        least = _SAMPLE / context.baseline.samples.rate_hz
        same = theta[0] / _ALIKE <= beta[0] <= theta[0] * _ALIKE
        return same and beta[0] >= least and super().is_admissible(context, location, theta, beta)

    @property
    def refined_form(self) -> Effect | None:
        return WholeDelay()

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.make_note(item),))


class WholeDelay(TimeDelay):
    """The same, all of the torque late by what is searched: a secant of free size leans on longer, smoother delays.

    ``τ_logged(t + d) = τ(t)``: what the log says later is set beside the model, whose columns do not depend on the
    delay. On the model's side the delay would be that of a prediction, which was fitted beside the delay before.
    """

    linear: ClassVar[tuple[Parameter, ...]] = ()
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("delay", "s", 4e-4, 0.15),)

    stands_in = False

    @property
    def refined_form(self) -> Effect | None:
        return None

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        early = -_logged_change(context.baseline, theta[0])
        return Shape(offset={j: early[:, j] for j in range(early.shape[1])})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return theta[0] >= _SAMPLE / context.baseline.samples.rate_hz

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """Its length as rows between reversals tell it, where they surely tell another than all rows do; else that."""
        found = super().to_estimates(context, location, theta, fit)
        told = estimate_delay(context.baseline.with_fit(fit), theta[0], delay_change)
        if told is None:
            return found
        off = abs(told.size - theta[0])
        if off > _SURELY * told.std:
            return found | {"delay": Estimate(told.size, told.std, "s")}
        # Where they agree, all rows may still be off by what these cannot tell.
        return found | {"delay": Estimate(theta[0], float(np.hypot(off, told.std)), "s")}

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        value = self.to_estimates(context, location, theta, fit)["delay"].value
        return super().to_sizes(context, location, theta, fit) | {"delay": value}


# A constant added to a torque channel.

_ASYMMETRY = "coulomb_asymmetry"
# Where friction differs between directions, half the difference is no more than its level; a fit is off by a little.
_OF_LEVEL = 1.1


class TorqueBias(Effect):
    """``τ_logged = τ + b``."""

    name = "torque_bias"
    observed_by = frozenset({Doubt.GRAVITY})
    linear = (Parameter("bias", "N·m"),)
    confusable_with = ("coulomb_asymmetry", "encoder_offset", "base_tilt", "joint_spring")
    separating_motion = "a reading at zero torque"
    mujoco = "added to the actuator's force"
    by_motion = True
    term = CONSTANT
    spans = ("1",)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return np.ones((len(context.v), 1))

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(bias=item.value_of("bias"))

    def second_name(self, baseline: Baseline, location: str, fit: Fit) -> str | None:
        """No larger than the Coulomb level, it may be friction that differs between directions."""
        if not COULOMB.is_modelled(baseline.modelled):
            return None
        own = baseline.fit.own_coefs[baseline.samples.joints.index(location)]
        level = abs(coulomb_level(baseline.modelled, own))
        return _ASYMMETRY if abs(float(fit.extra[0])) <= _OF_LEVEL * level else None
