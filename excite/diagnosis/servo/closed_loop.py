"""Closed-loop roll-outs of validation trials: the record's commands through the servo, with and without effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Rollout
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.attribution import Attribution, Hypothesis, Search, effective_counts, structured_joints
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.readings import ActuatorLag, TimeDelay, late
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.reversals import told_delay
from excite.diagnosis.equations.noise_floor import position_noise
from excite.diagnosis.equations.own_columns import coulomb_level
from excite.diagnosis.equations.repeats import on_the_clock_of_the_first
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.servo import (
    Cycle,
    Servo,
    Signals,
    Witness,
    acting,
    effect_strength,
    later,
    without_faint,
    witness,
)
from excite.diagnosis.simulator.model_text import MODEL
from excite.diagnosis.simulator.rollout_compare import compared
from excite.diagnosis.simulator.rollout_windows import Drive, Plan, PositionServo, spans
from excite.errors import InputError
from excite.logs.log import Trial
from excite.logs.signals.butterworth import lowpass, noise_bandwidth
from excite.progress import step

# How late a servo's commands, or its torques, are where a lag of its drives was found.
#
# A lag is told by its first order, or by two, of the torque that acts, with all that the servo's gains add to
# friction and rotors where something is late: commands that come 6 ms late, to a leg with kp of 150 N·m/rad,
# were a lag of 5.8 ms, and to a finger one of 2.5.


def delay_for_lag(
    attribution: Attribution, servo: Servo, signals: Mapping[str, Signals], cycle: Cycle, order: Sequence[int]
) -> Estimate | None:
    """The delay that stands in the place of an accepted lag, the first effect; None without a lag, or such a delay.

    Of commands, or of positions in the log, which are the same; or of all of the torque. What leaves less is meant.

    Args:
        attribution: all its steps.
        servo: the servo.
        signals: by trial.
        cycle: when the servo's torques act.
        order: of the samples' joints in the log.
    """
    first = attribution.stages[0]
    if first.accepted is None or first.accepted.name != ActuatorLag.name:
        return None

    def commands(base: Baseline, delay: float) -> Array:
        parts = []
        for trial in base.samples.trials:
            s = signals[trial.name]
            now = servo.kp * s.commanded.value + servo.damping_share * servo.kd * s.commanded.first
            change = later(s.time, now - later(s.time, now, delay), cycle.lag)
            parts.append(change[: len(trial.time), list(order)])
        return np.concatenate(parts)

    def torques(base: Baseline, delay: float) -> Array:
        return late(base, -delay)

    base, begin = first.context.baseline, float(first.accepted.hypothesis.fit.extra[0])
    told = [told_delay(base, begin, change) for change in (commands, torques)]
    best = min((one for one in told if one is not None), key=lambda one: one.loss, default=None)
    return None if best is None else Estimate(best.size, best.std, "s")


# What no roll-out of a log of commands can go below: noise and steps of encoders, as far as a filter lets
# them by.

# Places of an encoder's marks that the mean is taken over.
_PLACES = 8


def position_floor(samples: ArmSamples, logged: Mapping[str, Trial], joints: Sequence[str]) -> Array:
    """Noise of the filtered positions, ``(n_joints,)`` [rad or m]: the largest of three that it cannot be less than.

    - Noise that is seen above the motion's band is white: its density there times the filter's bandwidth.
    - An encoder of step ``s`` is off by ``s²/12``. While a joint passes many marks within the filter's time that is
      white and the filter takes most of it away; while it creeps or rests nothing does. So the marks are laid over the
      record's own motion, at several places, and what each reading is off by is filtered.
    - Trials that run one command again differ by what does not repeat, halved.

    Args:
        samples: the record, filtered.
        logged: its trials as they were logged, by name.
        joints: of the log, in its order.
    """
    trials = [logged[t.name] for t in samples.trials]
    columns = [list(joints).index(joint) for joint in samples.joints]
    passed = noise_bandwidth(samples.rate_hz, samples.bands.kinematics_hz)
    white = position_noise(samples, columns, trials) * np.sqrt(passed)
    steps = np.array([[t.cleaning.quantised.get(f"q.{j}", 0.0) for j in samples.joints] for t in trials])
    return np.asarray(np.max([white, _rounding(samples, steps), _unrepeated(samples)], axis=0))


def _rounding(samples: ArmSamples, steps: Array) -> Array:
    """RMS over all trials of what encoders of these steps, ``(n_trials, n_joints)``, are off by after the filter."""
    squares, count = np.zeros(len(samples.joints)), 0
    for trial, resolution in zip(samples.trials, steps, strict=True):
        squares += len(trial.time) * _filtered_rounding(samples, trial, resolution)
        count += len(trial.time)
    return np.asarray(np.sqrt(squares / count))


def _filtered_rounding(samples: ArmSamples, trial: ArmTrial, step: Array) -> Array:
    coarse = np.flatnonzero(step > 0.0)
    found = np.zeros(len(step))
    if len(coarse):
        q = trial.q[:, [samples.index[j] for j in coarse]] / step[coarse]
        for place in (np.arange(_PLACES) + 0.5) / _PLACES:
            off = lowpass(np.round(q + place) - q - place, samples.rate_hz, samples.bands.kinematics_hz)
            found[coarse] += (off**2).mean(axis=0) / _PLACES
    return found * step**2


def _unrepeated(samples: ArmSamples) -> Array:
    """RMS of half the difference of repeated trials' positions, times √2; 0 without repeats."""
    positions = [t.q[t.rows][:, list(samples.index)].T for t in samples.trials]
    both = [on_the_clock_of_the_first(repeat, samples.trials, positions) for repeat in samples.repeats]
    if not both:
        return np.zeros(len(samples.joints))
    return np.asarray(np.sqrt(np.concatenate([0.5 * (b - a) ** 2 for a, b in both], axis=1).mean(axis=1)))


# The servo as what drives a closed-loop roll-out.


def servo_drive(signals: Signals, servo: Servo, cycle: Cycle, order: list[int]) -> PositionServo:
    """The servo of one trial: at the record's own motion it gives the torques that the record was rebuilt with.

    It answers the simulated positions and velocities at once. What comes of acting later, and of damping a velocity
    that is not the log's, is small beside that and the record's: it stands in the feedforward, with the integral
    part, which over a roll-out has hardly heard of what is different there.

    Args:
        signals: of the trial.
        servo: the servo.
        cycle: when its torques act.
        order: the roll-out's joints in the log.

    Returns:
        The drive, on a clock that starts with the trial.
    """
    given = signals.feedforward(servo.feedforward) + signals.integral
    moved = acting(signals, servo, cycle) - signals.torque(servo)
    return PositionServo(
        time=signals.time - signals.time[0],
        q_cmd=signals.commanded.value[:, order],
        v_cmd=servo.damping_share * signals.commanded.first[:, order],
        feedforward=(given + moved)[:, order],
        kp=servo.kp[order],
        kd=servo.kd[order],
    )


# How a servo follows its commands: what hangs under weight, what dry friction holds back.

# Less than this is not worth a sentence [rad]: a step of a 12-bit encoder.
_LEAST = 1.5e-3


@dataclass(frozen=True, eq=False)
class Tracking:
    """Each joint's steady errors, in the order of the samples.

    Attributes:
        joints: names.
        hangs: ``(n_joints,)`` mean of measured less commanded position [rad].
        weighs: ``(n_joints,)`` what weight over kp, less feedforward and integral, makes one expect of it [rad].
        dead_band: ``(n_joints,)`` how far a command has to lead before dry friction lets go [rad].
    """

    joints: tuple[str, ...]
    hangs: Array
    weighs: Array
    dead_band: Array

    def sentences(self) -> tuple[str, ...]:
        """What is worth saying."""
        said = []
        low = [
            f"{name} {1e3 * h:+.0f} mrad (weight over kp: {1e3 * w:+.0f})"
            for name, h, w in zip(self.joints, self.hangs, self.weighs, strict=True)
            if min(abs(h), abs(w)) > _LEAST and h * w > 0.0
        ]
        if low:
            said.append("the arm hangs away from its commands under its weight: " + ", ".join(low))
        held = [
            f"{name} ±{1e3 * d:.1f} mrad"
            for name, d in zip(self.joints, self.dead_band, strict=True)
            if d > _LEAST
        ]
        if held:
            said.append("dry friction leaves a dead band about the commands: " + ", ".join(held))
        return tuple(said)


def tracking(baseline: Baseline, servo: Servo, signals: dict[str, Signals], order: Sequence[int]) -> Tracking:
    """Steady errors on the identification trials.

    Args:
        baseline: with all accepted effects.
        servo: the servo.
        signals: by trial.
        order: of the samples' joints in the log.

    Returns:
        The errors.
    """
    samples, columns = baseline.samples, list(order)
    kp = servo.kp[columns]
    late, weight = [], []
    for trial, rigid in zip(samples.trials, samples.split(baseline.rigid), strict=True):
        if not trial.identification:
            continue
        s = signals[trial.name]
        late.append((s.measured.value - s.commanded.value)[:, columns])
        given = s.feedforward(servo.feedforward) + s.integral
        weight.append(given[: len(rigid), columns] - rigid[: len(s.time)])
    dry = np.array([max(coulomb_level(baseline.modelled, own), 0.0) for own in baseline.fit.own])
    hangs, weighs = (np.concatenate(x).mean(axis=0) for x in (late, weight))
    return Tracking(samples.joints, hangs, weighs / kp, dry / kp)


_HORIZON_S = 2.0
# What each further effect has to take of some joint's squared error.
_GAIN = 0.1


@dataclass(eq=False)
class ClosedLoop:
    """Closed-loop roll-outs, and what the result needs of them afterwards.

    Attributes:
        servo: the servo.
        signals: by trial.
        cycle: when the servo's torques act.
        logged: its trials as they were logged, by name.
        out: folder for the augmented model.
        rollout: the comparison once it is made.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` what encoders and what does not repeat leave in filtered positions [rad].
        order: joints in the log's order.
        tracking: steady errors of the servo.
        kept: how many of the accepted effects bring the roll-outs nearer.
        strength: RMS of the first effect's torque over all torque's deviation, at the joint where it is most.
        structured: joints with a gap that effects strong enough leave.
        lags: whether the first effect is a lag and clearly no delay.
        delay: the delay that stands in its place; None where it is no lag.
        spans: pieces of trials that were simulated.
        witness: what roll-outs say of the accepted effects; None where there are none.
    """

    servo: Servo
    signals: dict[str, Signals]
    cycle: Cycle
    logged: Mapping[str, Trial]
    out: Path | None
    rollout: Rollout | None = None
    deviation: Array | None = None
    floor: Array | None = None

    @step("roll out in the simulator")
    def __call__(self, attribution: Attribution, baseline: Baseline) -> Rollout:
        """Make the roll-outs, with no effect that rebuilt torques are not exact enough for."""
        samples = baseline.samples
        order = [self.order.index(joint) for joint in samples.joints]
        self.tracking = tracking(attribution.final, self.servo, self.signals, order)
        q = samples.stacked("q")[:, list(samples.index)]
        inside = np.concatenate([np.full(len(t.time), t.identification) for t in samples.trials])
        self.deviation = np.maximum(q[inside].std(axis=0), 1e-9)
        self.floor = position_floor(samples, self.logged, self.order)
        self.strength = max((effect_strength(item) for item in attribution.accepted[:1]), default=np.inf)
        attribution = without_faint(attribution, baseline)
        self.structured = structured_joints(attribution, baseline.solver.equations.floor)
        self.lags = clearly_lags(attribution)
        self.delay = delay_for_lag(attribution, self.servo, self.signals, self.cycle, order)
        drives: dict[str, Drive] = {
            t.name: servo_drive(self.signals[t.name], self.servo, self.cycle, order) for t in samples.trials
        }
        shortest = min(float(t.time[-1]) for t in samples.trials)
        horizon = min(_HORIZON_S, 0.4 * shortest)
        plan = Plan(horizon, drives, "q_cmd", least_gain=_GAIN, all_effects=True, noise=self.floor)
        try:
            comparison = compared(attribution, baseline, plan)
        except InputError as error:
            self.rollout = Rollout({}, {}, _HORIZON_S, None, "q_cmd", (f"no roll-outs: {error}",))
            return self.rollout
        rollout, self.kept = comparison.rollout, comparison.kept
        self.spans = spans(samples, plan)
        if comparison.errors is not None:
            band = min(2.0 * samples.bands.rows_hz / samples.rate_hz, 1.0)
            self.witness = witness(*comparison.errors, band)
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            write_text(self.out / MODEL, comparison.xml)
            rollout = replace(rollout, model=MODEL)
        self.rollout = rollout
        return rollout

    order: tuple[str, ...] = ()
    tracking: Tracking | None = None
    kept: int = 0
    strength: float = np.inf
    witness: Witness | None = None
    lags: bool = False
    delay: Estimate | None = None
    structured: tuple[str, ...] = ()
    spans: tuple[tuple[str, float, float], ...] = ()


# A drive that follows with a lag against torques that act as they are, but late.

# Nats by which a lag has to lead a delay.
_CLEAR = 30.0


class Transport(TimeDelay):
    """Torques act a time d after they are asked for: ``u(t) = τ(t + d)``, as the secant of the predicted torque."""

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        column = late(context.baseline, -theta[0]) / theta[0]
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})


def clearly_lags(attribution: Attribution) -> bool:
    """Whether an accepted lag of the drives, the first effect, explains clearly more than a transport delay.

    The two turn the phase alike; a lag also lowers the amplitude, with the square of the frequency.
    """
    first = attribution.stages[0]
    if first.accepted is None or first.accepted.name != ActuatorLag.name:
        return False
    search = Search(first.context, first.context.baseline.solver)
    lag, late = _best(search, ActuatorLag()), _best(search, Transport())
    if lag is None or late is None:
        return False
    base = first.context.baseline
    residuals = [base.judged(item.fit.residual) for item in (lag, late)]
    counts = effective_counts(residuals[0], base.samples.identification, base.samples.trial_of_row).sum(
        axis=1
    )
    powers = [(r**2).mean(axis=1) for r in residuals]
    nats = 0.5 * float((counts * np.log(powers[1] / powers[0])).sum())
    return nats > _CLEAR


def _best(search: Search, effect: Effect) -> Hypothesis | None:
    coarse = search.coarse(effect, "torque")
    return None if coarse is None else search.refine(coarse)
