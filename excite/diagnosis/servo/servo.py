"""The servo of a command-only log: what it does with ``q_cmd``, and the torques that it must have asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.answer.answer import Rollout
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.attribution import Attribution, Scored, at_rows, structured_joints
from excite.diagnosis.effects.effect import Shape
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.readings import ActuatorLag, delay_change
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.dry_friction.reversals import between_reversals, estimate_delay
from excite.diagnosis.equations.noise_floor import position_noise, spectral_floor
from excite.diagnosis.equations.own_columns import ARMATURE, coulomb_level
from excite.diagnosis.equations.repeats import align_repeat
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.rollout import Drive, Plan
from excite.diagnosis.simulator.rollout_compare import compare_rollouts
from excite.errors import InputError, LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass, noise_bandwidth
from excite.progress import step
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.kinematics import trial_rate

BAND_HZ = 30.0
FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")
# Samples from a position's reading to the torque that answers it: computed in one cycle, held for the next.
_LONGEST_SAMPLES = 2.0
# Where the spectral floor is measured, in multiples of the rows' band.
_ABOVE = (1.5, 3.0)


@dataclass(frozen=True, eq=False)
class Servo:
    """``τ = kp (q_cmd − q) + kd (s·v_cmd − v) + feedforward`` of every joint.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        feedforward: ``none``, ``gravity`` of the nominal model at q, or its ``inverse_dynamics`` at the command.
        follows_velocity: s: whether the damping acts on the velocity's error or on the velocity itself.
        estimated: what was estimated and not stated.
        told: by name of a gain, ``(2, n_joints)``: as the record tells it, stated or not, and its standard deviation.
    """

    kp: Array
    kd: Array
    feedforward: str
    follows_velocity: bool
    estimated: tuple[str, ...] = ()
    told: Mapping[str, Array] = field(default_factory=dict)

    @property
    def damping_share(self) -> float:
        """s, 1 or 0."""
        return 1.0 if self.follows_velocity else 0.0


@dataclass(frozen=True, eq=False)
class Signals:
    """One trial's commands and motion on an even clock, the log's joints.

    Attributes:
        time: ``(n,)`` [s].
        measured: position and its derivatives, ``(n, n_joints)``.
        commanded: the command's.
        gravity: torque that holds the measured position by the servo's model ``(n, n_joints)`` [N·m].
        dynamics: inverse dynamics at the command by that model.
        nominal: nominal inverse dynamics at the measured motion.
    """

    time: Array
    measured: Derivatives
    commanded: Derivatives
    gravity: Array
    dynamics: Array
    nominal: Array

    def feedforward_torque(self, kind: str) -> Array:
        """Torque that the servo adds, ``(n, n_joints)`` [N·m]."""
        return {"none": 0.0 * self.gravity, "gravity": self.gravity, "inverse_dynamics": self.dynamics}[kind]

    def commanded_torque(self, servo: Servo) -> Array:
        """What the servo would ask for with the joints at zero and at rest, but for its feedforward [N·m]."""
        return servo.kp * self.commanded.value + servo.damping_share * servo.kd * self.commanded.first

    def servo_torque(self, servo: Servo) -> Array:
        """What the servo asked its motors for, ``(n, n_joints)`` [N·m]."""
        fed_back = servo.kp * self.measured.value + servo.kd * self.measured.first
        return self.commanded_torque(servo) - fed_back + self.feedforward_torque(servo.feedforward)

    def acting_torque(self, servo: Servo, lag: float) -> Array:
        """The same as it acts, later by a lag [s]."""
        return delay_torques(self.time, self.servo_torque(servo), lag)


def read_signals(robot: Robot, log: Log, trial: Trial, controller: Robot | None = None) -> Signals:
    """Commands and motion of a trial, differentiated.

    Args:
        robot: the nominal model.
        log: the log, for its header.
        controller: the model that the servo's feedforward was computed with, where it is another.

    Raises:
        LogError: the trial has no commands.
    """
    if trial.q_cmd is None:
        raise LogError(
            "has neither torques nor commands",
            source=trial.name,
            field="q_cmd",
            remedy="log q_cmd.* or tau.*",
        )
    rate = trial_rate(log.header, trial)
    index = [robot.joint_index(name) for name in log.header.joints]
    q, c = (central_differences(lowpass(x, rate, BAND_HZ), rate) for x in (trial.q, trial.q_cmd))

    def body_torque(model: pin.Model, d: Derivatives, moving: float) -> Array:
        full = np.zeros((3, len(trial.time), robot.model.nv))
        full[0] = robot.rest
        for part, values in zip(full, (d.value, moving * d.first, moving * d.second), strict=True):
            part[:, index] = values
        return inverse_dynamics(model, *full)[:, index]

    forward = (controller or robot).model
    return Signals(
        trial.time,
        q,
        c,
        body_torque(forward, q, 0.0),
        body_torque(forward, c, 1.0),
        body_torque(robot.model, q, 1.0),
    )


def delay_torques(time: Array, torque: Array, lag: float) -> Array:
    """Torques ``(n, n_joints)`` as they act, later by a lag [s]."""
    return np.column_stack([np.interp(time - lag, time, column) for column in torque.T])


def cycle_lag(samples: ArmSamples, modelled: tuple[str, ...]) -> float:
    """How much later than it was asked for a servo's torque acts [s]: its cycle, and the filter of its encoders.

    A digital servo reads its encoders, computes for a cycle and holds its torque for another one (Franklin,
    Powell, Workman 1998, chapter 4), and a filter of the logged positions adds its own delay: without a torque
    channel none of this can be told from a lag of the drive. Each joint's lag is fitted beside the baseline; the
    median over the joints hardly heeds one joint that has something else.

    Args:
        samples: trials with the torques that were asked for.
        modelled: what the baseline has.

    Returns:
        The lag; 0 where there is none, or one that is longer than two samples.
    """
    baseline = fit_baseline(samples, (*modelled, *ARMATURE.words), spectral_floor(samples), late=False)
    context, n = Context(baseline), len(samples.joints)
    common = ActuatorLag().shape(context, "torque", ()).columns
    apart = Shape({j: column * np.eye(n)[j] for j, column in common.items()})
    lag = float(np.median(baseline.solver.fit_columns(at_rows(context, apart).extra).extra))
    return lag if 0.0 < lag <= _LONGEST_SAMPLES / samples.rate_hz else 0.0


def servo_floor(samples: ArmSamples, servo: Servo, order: list[int]) -> Array:
    """Noise in the rows' band, ``(n_joints,)`` [N·m], of torques rebuilt from positions.

    Above the band the noise is measured; below it is what the servo makes of encoders whose noise is white: it
    grows with the frequency as ``|kp + i 2πf kd|``, by several times within a decade where kd/kp is long. A floor
    that took it for flat would hide all that is weak.

    Args:
        samples: trials with torques rebuilt with this servo.
        order: of the samples' joints in the log.
    """
    rate, rows_hz = samples.rate_hz, samples.bands.rows_hz
    f = np.linspace(0.0, 0.5 * rate, 2000)[1:]
    grown = servo.kp[order] ** 2 + (2.0 * np.pi * f[:, None] * servo.kd[order]) ** 2
    grown *= _power_passed(f, BAND_HZ, rate)[:, None]
    high = min(_ABOVE[1] * rows_hz, 0.45 * rate)
    low = min(_ABOVE[0] * rows_hz, 0.7 * high)
    above = np.median(grown[(f > low) & (f < high)], axis=0)
    passed = _power_passed(f, rows_hz, rate)[:, None]
    share = np.minimum((grown * passed).sum(axis=0) / (above * passed.sum()), 1.0)
    return np.asarray(spectral_floor(samples) * np.sqrt(share))


def _power_passed(f: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """Share of the power at ``f`` [Hz] that a fourth-order Butterworth filter run both ways lets through."""
    if cutoff_hz >= 0.5 * rate_hz:
        return np.ones_like(f)
    warped = np.tan(np.pi * np.minimum(f, 0.4999 * rate_hz) / rate_hz) / np.tan(np.pi * cutoff_hz / rate_hz)
    return 1.0 / (1.0 + warped**8) ** 2


# Closed-loop roll-outs of validation trials: the record's commands through the servo, with and without
# effects.

_HORIZON_S = 2.0
# What each further effect has to take of some joint's squared error.
_GAIN = 0.1
# Nats by which a lag has to lead a delay to be none.
_CLEAR = 30.0
# How exact torques are that are rebuilt from commands and positions: cycles, held commands, encoders' filters.
EXACT = 0.015
# Places of an encoder's marks that the mean is taken over.
_PLACES = 8
# A sag of less is not worth a sentence [rad]: a step of a 12-bit encoder.
_LEAST = 1.5e-3


@dataclass(frozen=True, eq=False)
class ServoRecord:
    """A command-only log as torques that act.

    Attributes:
        servo: the servo.
        signals: by trial.
        lag: of its torques behind commands and positions [s].
        logged: its trials as they were logged, by name.
        joints: of the log, in order.
    """

    servo: Servo
    signals: Mapping[str, Signals]
    lag: float
    logged: Mapping[str, Trial]
    joints: tuple[str, ...]

    def joint_order(self, samples: ArmSamples) -> list[int]:
        """The samples' joints in the log."""
        return [self.joints.index(joint) for joint in samples.joints]

    def make_drive(self, trial: str, order: list[int]) -> Drive:
        """The servo of one trial: at the record's own motion it gives the torques that the record was rebuilt with.

        It answers the simulated positions and velocities at once. What comes of acting later is small beside that and
        the record's: it stands in the feedforward.

        Args:
            trial: its name.
            order: the roll-out's joints in the log.
        """
        s, servo = self.signals[trial], self.servo
        moved = s.acting_torque(servo, self.lag) - s.servo_torque(servo)
        torque = s.commanded_torque(servo) + s.feedforward_torque(servo.feedforward) + moved
        return Drive(s.time - s.time[0], torque[:, order], servo.kp[order], servo.kd[order])


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What closed-loop roll-outs say, and what stands beside them.

    Attributes:
        rollout: the comparison.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` what encoders and what does not repeat leave in filtered positions [rad].
        sentences: how the servo follows its commands.
        strength: RMS of the first effect's torque over all torque's deviation, at the joint where it is most.
        structured: joints with a gap that effects strong enough leave.
        delay: the delay that stands in the place of a lag; None where there is no lag, or it is clearly none.
        kept: how many of the accepted effects bring the roll-outs nearer.
        spans: pieces of trials that were simulated.
        witness: what roll-outs say of the accepted effects; None where there are none.
    """

    rollout: Rollout
    deviation: Array
    floor: Array
    sentences: tuple[str, ...]
    strength: float
    structured: tuple[str, ...]
    delay: Estimate | None
    kept: int = 0
    spans: tuple[tuple[str, float, float], ...] = ()
    witness: RolloutAgreement | None = None


@step("roll out in the simulator")
def roll_out(record: ServoRecord, attribution: Attribution, out: Path | None) -> ClosedLoop:
    """Closed-loop roll-outs, with no effect that rebuilt torques are not exact enough for.

    Args:
        record: the log.
        out: folder for the augmented model.
    """
    samples = attribution.baseline.samples
    order = record.joint_order(samples)
    inside = np.concatenate([t.q for t in samples.trials if t.identification])[:, list(samples.index)]
    strong = drop_faint_effects(attribution)
    found = {
        "deviation": np.maximum(inside.std(axis=0), 1e-9),
        "floor": position_floor(samples, record.logged, record.joints),
        "sentences": tracking_sentences(attribution.final, record),
        "strength": max((effect_strength(item) for item in attribution.accepted[:1]), default=np.inf),
        "structured": structured_joints(strong, attribution.baseline.solver.equations.floor),
        "delay": delay_for_lag(strong, record),
    }
    drives = {t.name: record.make_drive(t.name, order) for t in samples.trials}
    horizon = min(_HORIZON_S, 0.4 * min(float(t.time[-1]) for t in samples.trials))
    plan = Plan(horizon, drives, "q_cmd", least_gain=_GAIN, all_effects=True, noise=found["floor"])
    try:
        made = compare_rollouts(strong, plan)
    except InputError as error:
        return ClosedLoop(Rollout({}, {}, horizon, None, "q_cmd", (f"no roll-outs: {error}",)), **found)
    band = min(2.0 * samples.bands.rows_hz / samples.rate_hz, 1.0)
    said = None if made.errors is None else measure_rollout_agreement(*made.errors, band)
    return ClosedLoop(made.write_model(out), **found, kept=made.kept, spans=made.spans, witness=said)


def effect_strength(item: Scored) -> float:
    """RMS of an effect's torque over a joint's whole torque's deviation, at most; infinite where it has no columns."""
    h, samples = item.hypothesis, item.hypothesis.baseline.samples
    if h.columns.extra is None:
        return float(np.inf)
    made = np.sqrt(((h.columns.extra @ h.fit.extra) ** 2).mean(axis=1))
    return float((made / samples.to_rows([t.measured_torque for t in samples.trials]).std(axis=0)).max())


def drop_faint_effects(attribution: Attribution) -> Attribution:
    """The effects up to the first that rebuilt torques are not exact enough for.

    The noise floor stays, and the parameters of the effects before it that were fitted beside it: what is so faint
    moves neither by more than 0.3 %.
    """
    strengths = [effect_strength(item) for item in attribution.accepted]
    return attribution.first_n(next((k for k, size in enumerate(strengths) if size < EXACT), len(strengths)))


def delay_for_lag(attribution: Attribution, record: ServoRecord) -> Estimate | None:
    """The delay that stands in the place of an accepted lag, the first effect; None where there is none, or no delay.

    Of commands, or of positions in the log, which are the same; or of all of the torque. What leaves less is meant. A
    lag is told by its first order, or by two, of the torque that acts, with all that the servo's gains add to friction
    and rotors where something is late: commands that come 6 ms late, to a leg with kp of 150 N·m/rad, were a lag of
    5.8 ms, and to a finger one of 2.5. Both turn the phase alike; a lag also lowers the amplitude, and may be clearly
    none.

    Args:
        attribution: the effects.
    """
    first = next(iter(attribution.accepted), None)
    if first is None or first.name != ActuatorLag.name:
        return None

    def late_commands(base: Baseline, delay: float) -> Array:
        parts, order = [], record.joint_order(base.samples)
        for trial in base.samples.trials:
            s = record.signals[trial.name]
            now = s.commanded_torque(record.servo)
            change = delay_torques(s.time, now - delay_torques(s.time, now, delay), record.lag)
            parts.append(change[: len(trial.time), order])
        return np.concatenate(parts)

    def late_torques(base: Baseline, delay: float) -> Array:
        return delay_change(base, -delay)

    base, lag = first.hypothesis.baseline, first.hypothesis
    told = [estimate_delay(base, float(lag.fit.extra[0]), change) for change in (late_commands, late_torques)]
    best = min((one for one in told if one is not None), key=lambda one: one.loss, default=None)
    if best is None:
        return None
    there, use = between_reversals(base.samples), base.solver.equations.use
    left = np.log(((lag.fit.residual * there)[:, use] ** 2).mean(axis=1)).sum()
    independent = float(first.count[:, 0].mean())
    return None if 0.5 * independent * (best.loss - left) > _CLEAR else Estimate(best.size, best.std, "s")


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
    rate, band, n = samples.rate_hz, samples.bands.kinematics_hz, len(samples.joints)
    trials = [logged[t.name] for t in samples.trials]
    columns = [list(joints).index(joint) for joint in samples.joints]
    white = position_noise(samples, columns, trials) * np.sqrt(noise_bandwidth(rate, band))
    rounded, count = np.zeros(n), 0
    positions = [t.q[:, list(samples.index)] for t in samples.trials]
    for q, trial in zip(positions, trials, strict=True):
        marks = np.array([trial.cleaning.quantised.get(f"q.{joint}", 0.0) for joint in samples.joints])
        coarse, count = marks > 0.0, count + len(q)
        for place in (np.arange(_PLACES) + 0.5) / _PLACES if coarse.any() else ():
            steps = q[:, coarse] / marks[coarse] + place
            off = lowpass(np.round(steps) - steps, rate, band) * marks[coarse]
            rounded[coarse] += (off**2).sum(axis=0) / _PLACES
    rows = [q[t.rows].T for q, t in zip(positions, samples.trials, strict=True)]
    pairs = [align_repeat(repeat, samples.trials, rows) for repeat in samples.repeat_pairs]
    apart = np.hstack([np.zeros((n, 1)) if not pairs else np.zeros((n, 0)), *(b - a for a, b in pairs)])
    return np.asarray(
        np.max([white, np.sqrt(rounded / count), np.sqrt(0.5 * (apart**2).mean(axis=1))], axis=0)
    )


def tracking_sentences(baseline: Baseline, record: ServoRecord) -> tuple[str, ...]:
    """How a servo follows its commands in the identification trials: what hangs under weight, what friction holds.

    Args:
        baseline: with all accepted effects.
    """
    samples, servo = baseline.samples, record.servo
    order = record.joint_order(samples)
    kp, errors, weight = servo.kp[order], [], []
    for trial, rigid in zip(samples.trials, samples.by_trial(baseline.rigid), strict=True):
        if trial.identification:
            s = record.signals[trial.name]
            errors.append((s.measured.value - s.commanded.value)[:, order])
            given = s.feedforward_torque(servo.feedforward)[: len(rigid), order]
            weight.append((given - rigid[: len(s.time)]) / kp)
    hangs, weighs = (np.concatenate(x).mean(axis=0) for x in (errors, weight))
    dry = np.array([max(coulomb_level(baseline.modelled, own), 0.0) for own in baseline.fit.own_coefs]) / kp
    low = [
        f"{name} {1e3 * h:+.0f} mrad (weight over kp: {1e3 * w:+.0f})"
        for name, h, w in zip(samples.joints, hangs, weighs, strict=True)
        if min(abs(h), abs(w)) > _LEAST and h * w > 0.0
    ]
    held = [f"{name} ±{1e3 * d:.1f} mrad" for name, d in zip(samples.joints, dry, strict=True) if d > _LEAST]
    said = {
        "the arm hangs away from its commands under its weight: ": low,
        "dry friction leaves a dead band about the commands: ": held,
    }
    return tuple(text + ", ".join(items) for text, items in said.items() if items)


# Whether the change that effects make to closed-loop roll-outs goes the way that the record asks for.

# A change of less than this share of the roll-outs' amplitude of error is lost in it; one so much larger than what it
# is to explain is a simulation that gets nowhere.
_HEARD, _WILD = 0.1, 10.0
# Standard errors by which a change has to go the right way.
_SURE = 2.0
# Fewer roll-outs do not tell by how much they disagree.
_ROLLOUTS = 4
# A change of which so little goes the right way makes things worse, however surely.
_LITTLE = 0.1


@dataclass(frozen=True)
class RolloutAgreement:
    """What roll-outs say of effects.

    Attributes:
        slope: share of the effects' change that the error without them asks for: 1 where they are all that is missing,
            0 where they have nothing to do with it; NaN where roll-outs with them diverge.
        error: standard error of the slope.
        heard: amplitude of the change over that of the error, at the joint where it is most.
    """

    slope: float
    error: float
    heard: float

    @property
    def is_contradicting(self) -> bool:
        """Whether the change is surely less than foretold, and not surely any of it the right way.

        A simulation that gets nowhere says nothing, nor does a change within the error.
        """
        if not (np.isfinite(self.slope) and _HEARD <= self.heard <= _WILD):
            return False
        return self.slope < 1.0 - _SURE * self.error and self.slope < max(_SURE * self.error, _LITTLE)


def measure_rollout_agreement(before: Array, after: Array, band: float = 1.0) -> RolloutAgreement:
    """Regress what the record asks for on what effects do.

    Under feedback the positions hardly show an effect that the torques show well: how much of the error goes
    tells little where friction, noise and the start have most of it. Whether what goes is what was foretold does.
    Every frequency weighs by the error that there is without the effects, in octaves: slow errors of friction are
    the largest, and would drown what a soft gear does (generalised least squares, Aitken 1936).

    Args:
        before: simulated less recorded positions without the effects ``(n_windows, n, n_joints)`` [rad].
        after: with them.
        band: share of the frequencies up to half the sampling rate that effects were fitted in: beyond, a filtered
            record has next to nothing, and the start of a simulation has something.

    Returns:
        What they say, all joints weighed by their errors without the effects.
    """
    from scipy.fft import dct

    size = np.sqrt((before**2).mean(axis=(0, 1))) + 1e-12
    change = (after - before) / size
    if not np.isfinite(after).all() or not change.any():
        return RolloutAgreement(np.nan, np.nan, 0.0)
    heard = float(np.sqrt((change**2).mean(axis=(0, 1))).max())
    # Of the cosine transform: what begins and ends apart leaks next to nothing into it.
    count = max(round(band * before.shape[1]), 1)
    old, new = (dct(x, axis=1, norm="ortho")[:, :count] for x in (before / size, change))
    octave, levels = np.frexp(np.arange(count))[1], np.empty(old.shape[1:])
    for k in np.unique(octave):
        levels[octave == k] = np.sqrt((old[:, octave == k] ** 2).mean(axis=(0, 1))) + 1e-9
    old, new = old / levels, new / levels
    asked, made = (-old * new).sum(axis=(1, 2)), (new**2).sum(axis=(1, 2))
    total, n = float(made.sum()), len(made)
    slope = float(asked.sum()) / total
    # Of a ratio of sums over the joints and frequencies of each roll-out (Cochran 1977, section 6.3).
    spread = float(np.sqrt(n / max(n - 1, 1) * ((asked - slope * made) ** 2).sum()))
    return RolloutAgreement(slope, spread / total if n >= _ROLLOUTS else np.inf, heard)
