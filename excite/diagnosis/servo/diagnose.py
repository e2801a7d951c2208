"""The diagnosis of a log without torque: what its servo must have asked for, and closed-loop simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.absorbed import Absorbed, estimated_gains
from excite.diagnosis.answer.answer import Diagnosis, NextExperiment, Rollout
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.answer.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.answer.trivial import beaten
from excite.diagnosis.arm.diagnose import diagnose_arm, diagnose_torques
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.attribution import STRUCTURED
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Context, Form, Sizes
from excite.diagnosis.effects.readings import EncoderOffset, TimeDelay, TorqueGain
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.closed_loop import ClosedLoop
from excite.diagnosis.servo.gains import known_servo
from excite.diagnosis.servo.servo import (
    BAND_HZ,
    EXACT,
    Servo,
    Signals,
    Witness,
    acting,
    error_integral,
    read_signals,
    servo_cycle,
    trial_levels,
)
from excite.diagnosis.trivial import of_positions
from excite.errors import LogError, RobotError
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.resample import is_uniform, resample_smooth, uniform_grid
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.kinematics import trial_rate

# A log without a torque channel has none of them.
_CHANNEL = tuple(effect.name for effect in EFFECTS.values() if effect.of_channel)


def diagnose_commands(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None = None) -> Diagnosis:
    """Diagnose a log of a fixed-base arm that has commands and no torques.

    The torque that the servo must have asked for follows from its gains and from what it saw; effects are fitted
    to that torque, then judged on closed-loop roll-outs of the validation trials, in which the gap is stated.
    Where every trial has ``tau_cmd``, what the servo asked for is known: those are the torques.

    Args:
        robot: the nominal model.
        log: the log, with an identification trial.
        rng: of the bootstrap.
        out: folder for the augmented simulator.

    Returns:
        The diagnosis.

    Raises:
        LogError: no commands, gains neither stated nor to be had.
    """
    if all(trial.tau_cmd is not None for trial in log.trials):
        return _asked(robot, log, rng, out)
    trials = tuple(_evened(log, t) for t in log.trials)
    controller = _controllers(log)
    signals = {t.name: read_signals(robot, log, t, controller) for t in trials}
    fitted = {t.name: signals[t.name] for t in trials if t.role == "identification"}
    servo = known_servo(robot, log, fitted)
    # A wrong scale of a joint's torques is its gain's where that was estimated.
    guessed = (TorqueGain.name,) if any(name.startswith("kp of") for name in servo.estimated) else ()
    modelled = (*log.header.modelled, *_CHANNEL, *guessed)
    if servo.ki is not None and servo.ki.any():
        signals = _wound(robot, log, trials, signals, servo, servo.ki, modelled)
    asked = tuple(replace(t, tau=signals[t.name].torque(servo)) for t in trials)
    samples = arm_samples(robot, log, asked)
    order = [log.header.joints.index(name) for name in samples.joints]
    cycle = servo_cycle(samples, modelled, servo.kd[order], servo.rate_hz)
    asked = tuple(replace(t, tau=acting(signals[t.name], servo, cycle)) for t in trials)
    closed = ClosedLoop(servo, signals, cycle, {t.name: t for t in trials}, out, order=log.header.joints)

    def floor_of(samples: ArmSamples) -> Array:
        return servo_floor(samples, servo, order)

    library = servo_effects(servo, log.header.joints)
    record = TorqueRecord(robot, replace(log, trials=asked), modelled, out, floor_of, library)
    found = _judged(diagnose_torques(record, rng, closed), closed)
    found = replace(found, absorbed=(*_gains(robot, log.header.joints, servo), *found.absorbed))
    return _beside_neighbours(found, robot, log, closed)


def _gains(robot: Robot, joints: tuple[str, ...], servo: Servo) -> Iterator[Absorbed]:
    """Gains of the servo that nobody stated."""
    for name, unit, values in (("kp", "N·m/rad", servo.kp), ("kd", "N·m·s/rad", servo.kd)):
        guessed = [f"{name} of {joint}" in servo.estimated for joint in joints]
        yield from estimated_gains(robot, joints, name, unit, values, guessed, servo.spread.get(name))


def _beside_neighbours(found: Diagnosis, robot: Robot, log: Log, closed: ClosedLoop) -> Diagnosis:
    """The diagnosis with what simple predictors of the positions reach on the same rows."""
    rolled = closed.rollout if closed.rollout is not None and closed.rollout.after else None
    floor = {} if rolled is None else {n: c.noise_floor for n, c in found.gap.per_channel.items()}
    errors = of_positions(
        robot,
        log,
        tuple(found.gap.per_channel),
        closed.spans,
        None if rolled is None else rolled.after,
        floor,
    )
    return replace(found, trivial=errors, faults=(*found.faults, *beaten(errors)))


def _controllers(log: Log) -> Robot | None:
    """The robot that the log names: what the servo knew, whichever model the diagnosis starts from."""
    if log.folder is None:
        return None
    try:
        return nominal_robot(log)
    except (LogError, RobotError):
        # One that is handed over in the place of a robot that is not there is all that is known of it.
        return None


def _wound(
    robot: Robot,
    log: Log,
    trials: tuple[Trial, ...],
    signals: dict[str, Signals],
    servo: Servo,
    ki: Array,
    modelled: tuple[str, ...],
) -> dict[str, Signals]:
    """The signals with the torque of the servo's integral part."""
    grown = {k: replace(s, integral=ki * error_integral(s)) for k, s in signals.items()}
    samples = arm_samples(robot, log, [replace(t, tau=grown[t.name].torque(servo)) for t in trials])
    levels = trial_levels(samples, modelled)
    order = [samples.joints.index(joint) for joint in log.header.joints]
    # Joints without an integral part have nothing to start from.
    has = ki != 0.0
    return {k: replace(s, integral=s.integral + has * levels[k][order]) for k, s in grown.items()}


def _asked(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None) -> Diagnosis:
    """The diagnosis from commanded torques."""
    header = log.header.model_copy(update={"torque": "motor_side"})
    trials = tuple(replace(trial, tau=trial.tau_cmd, tau_cmd=None) for trial in log.trials)
    result = diagnose_arm(robot, replace(log, header=header, trials=trials), rng, out)
    said = (
        "torques are tau_cmd, what was asked of the drives: a torque_gain or torque_bias is the drive's own"
    )
    return replace(result, warnings=(*result.warnings, said))


def _evened(log: Log, trial: Trial) -> Trial:
    """The trial on an even clock."""
    rate = trial_rate(log.header, trial)
    if trial.q_cmd is None or is_uniform(trial.time, rate):
        return trial
    grid = uniform_grid(trial.time, rate)
    q, q_cmd = (resample_smooth(trial.time, x, grid) for x in (trial.q, trial.q_cmd))
    return Trial(
        trial.name,
        trial.role,
        grid,
        q,
        q_cmd=q_cmd,
        session=trial.session,
        start_s=trial.start_s,
        repeats=trial.repeats,
        cleaning=trial.cleaning,
    )


def _judged(result: Diagnosis, closed: ClosedLoop) -> Diagnosis:
    """The verdict after the roll-outs, with the gap in positions and what no torque leaves open."""
    gap, warnings = result.gap, list(result.warnings)
    rollout, servo = closed.rollout, closed.servo
    warnings.append(
        "the log has no torque: an error of a torque sensor cannot be seen, and where friction ends and the "
        "drive's own losses begin cannot be told"
    )
    warnings += closed.cycle.sentences()
    if closed.tracking is not None:
        warnings += closed.tracking.sentences()
    if servo.ki is not None and servo.ki.any():
        warnings.append(
            "what the servo's integral part had come to when a trial began is not in the log and was taken from the "
            "model: a constant torque, and the constant part of what a payload needs, cannot be seen"
        )
    if servo.estimated:
        warnings.append(
            "not stated and estimated with the nominal masses for a scale: " + ", ".join(servo.estimated)
        )
    if not servo.follows_velocity and any(name.startswith("kd of") for name in servo.estimated):
        warnings.append(
            "the servo brakes the velocity itself by damping that is not stated: viscous friction is within it"
        )
    if rollout is None or not rollout.before or closed.deviation is None or closed.floor is None:
        return replace(result, warnings=tuple(warnings))
    gap = position_gap(rollout, closed.deviation, closed.floor)
    unaided = replace(rollout, after=rollout.before)
    result = replace(result, gap=gap)
    unexplained = above_noise(closed.structured, gap)
    faint = closed.strength < EXACT
    if result.effects and (faint or not confirmed(gap, closed.witness)):
        named = " and ".join(f"{e.effect} at {e.location}" for e in result.effects)
        but = (
            f"torques rebuilt from a servo are no more exact than its {100 * closed.strength:.1f} % of them"
            if faint
            else "closed-loop roll-outs do not confirm it"
        )
        warnings.append(f"the servo's torques speak for {named}, {but}")
        # What is no gap without an effect so faint is none with it.
        silent = faint and not unexplained
        result = replace(
            result,
            verdict="none" if silent else "unknown",
            location=None if silent else result.location,
            effect=None,
            effects=(),
            tied_locations=(),
            n_tied=0,
            next_experiment=None,
        )
    elif result.verdict in {"effect", "ambiguous"}:
        # A further effect that roll-outs know nothing of is one of the servo that was taken for another.
        result = replace(result, effects=result.effects[: max(closed.kept, 1)])
        guessed = any(name.startswith(("kp of", "kd of")) for name in servo.estimated)
        if result.verdict == "effect":
            result = with_twin(result, guessed, lags=closed.lags, delay=closed.delay)
    elif result.verdict == "unknown" and result.location in closed.structured:
        # Where positions show no gap, what torques made of them call clear is the encoders' noise.
        result = replace(
            result,
            verdict="unknown" if unexplained else "none",
            location=unexplained[0] if unexplained else None,
            effects=result.effects[: max(closed.kept, 1)] if unexplained else (),
            gap=gap if unexplained else position_gap(unaided, closed.deviation, closed.floor),
        )
    return replace(result, warnings=tuple(warnings))


# Whether closed-loop roll-outs confirm what the servo's torques speak for, and what stays open without
# torque.

# Effects that leave more of every joint's roll-out error are not confirmed, nor are those that make it worse.
_CONFIRMS = 0.95


def confirmed(gap: Gap, said: Witness | None = None) -> bool:
    """Whether roll-outs are clearly nearer to the record, or at least do not speak against the effects.

    Nearer is on some joint, and no further in all. What the encoders' noise has of the error, no simulator takes
    away.

    Args:
        gap: of roll-outs with the effects that help.
        said: by all effects' change of the roll-outs.
    """
    if said is not None and not said.speaks_against:
        return True

    def left(value: float, floor: float) -> float:
        return float(np.sqrt(max(value**2 - floor**2, 0.0)))

    channels = gap.per_channel.values()
    return gap.after <= gap.before and any(
        left(c.after, c.noise_floor) < _CONFIRMS * left(c.before, c.noise_floor) for c in channels
    )


def position_gap(rollout: Rollout, deviation: Array, floor: Array) -> Gap:
    """The gap in positions, from closed-loop roll-outs.

    Args:
        rollout: the comparison.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` noise of the filtered positions [rad].
    """
    names = list(rollout.before)
    before, after = (np.array([x[n] for n in names]) for x in (rollout.before, rollout.after))
    floor = np.minimum(floor, np.minimum(before, after))
    first, last, least = (float(np.sqrt(np.mean((x / deviation) ** 2))) for x in (before, after, floor))
    channels = {
        n: ChannelGap(float(b), float(a), float(f), "rad")
        for n, b, a, f in zip(names, before, after, floor, strict=True)
    }
    return Gap(first, last, least, share_closed(first, last, least), channels)


def above_noise(joints: Sequence[str], gap: Gap) -> tuple[str, ...]:
    """Those of some joints whose roll-outs are off by more than the noise of the positions that they are held against.

    What torques leave there else, a servo that stiff, or encoders that coarse, hide in the positions; the torques are
    made of the same positions.

    Args:
        joints: with a rest of their torques that is no noise.
        gap: of roll-outs.
    """
    return tuple(
        j
        for j in joints
        if j in gap.per_channel
        and gap.per_channel[j].after ** 2 > STRUCTURED * gap.per_channel[j].noise_floor ** 2
    )


def with_twin(
    result: Diagnosis, estimated: bool, *, lags: bool = False, delay: Estimate | None = None
) -> Diagnosis:
    """Ambiguous where another name means the same without torque.

    Args:
        result: the diagnosis.
        estimated: whether gains were estimated: inertia and braking that a joint lacks, or has too
            much, are a wrong gain then.
        lags: whether a lag is clearly no delay.
        delay: what a delay in the place of a lag would be.
    """
    first = result.effects[0]
    effect = EFFECTS[first.effect]
    names = () if lags else effect.twins_without_torque
    twins = [replace(first, effect=name) for name in (*names, *(effect.twins_of_a_gain if estimated else ()))]
    if not twins:
        return result
    if delay is not None:
        twins = [replace(t, parameters={"delay": delay}) if t.effect == TimeDelay.name else t for t in twins]
    rest = tuple(c for c in result.candidates if (c.effect, c.location) != (first.effect, first.location))
    tied: tuple[Candidate, ...] = (first, *twins)
    said = " and ".join(c.effect.replace("_", " ") for c in tied)
    return replace(
        result,
        verdict="ambiguous",
        candidates=(*tied, *rest),
        n_tied=len(tied),
        next_experiment=NextExperiment(
            f"{said} look alike without torque; what tells them apart: a torque or current reading",
            tuple(f"{c.effect}@{c.location}" for c in tied),
        ),
    )


# Encoder offsets where the servo's own reading counts: of the encoder that it follows, or of the log alone.

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


# Noise of torques that a servo must have asked for: its encoders' noise, and what the servo makes of it.

# Where the spectral floor is measured, in multiples of the rows' band.
_ABOVE = (1.5, 3.0)


def servo_floor(samples: ArmSamples, servo: Servo, order: list[int]) -> Array:
    """Noise in the rows' band, ``(n_joints,)`` [N·m], of torques rebuilt from positions.

    Above the band the noise is measured; below it is what the servo makes of encoders whose noise is white: it
    grows with the frequency as ``|kp + i 2πf kd|``, by several times within a decade where kd/kp is long. A floor
    that took it for flat would hide all that is weak. An integral part makes a random walk of it, of which each trial's
    mean is taken off: ``ki² S T/12`` is left of it after a time T, S the density of the encoders' noise.

    Args:
        samples: trials with torques rebuilt with this servo.
        servo: the servo.
        order: of the samples' joints in the log.

    Returns:
        The floor.
    """
    rate, rows_hz = samples.rate_hz, samples.bands.rows_hz
    f = np.linspace(0.0, 0.5 * rate, 2000)[1:]
    kp, kd = servo.kp[order], servo.kd[order]
    grown = kp**2 + (2.0 * np.pi * f[:, None] * kd) ** 2
    grown *= _passed(f, BAND_HZ, rate)[:, None]
    high = min(_ABOVE[1] * rows_hz, 0.45 * rate)
    low = min(_ABOVE[0] * rows_hz, 0.7 * high)
    above = np.median(grown[(f > low) & (f < high)], axis=0)
    passed = _passed(f, rows_hz, rate)[:, None]
    share = np.minimum((grown * passed).sum(axis=0) / (above * passed.sum()), 1.0)
    if servo.ki is not None:
        seconds = np.mean([t.time[-1] - t.time[0] for t in samples.trials])
        share += servo.ki[order] ** 2 * seconds / 12.0 / (above * passed.sum() * (f[1] - f[0]))
    return np.asarray(spectral_floor(samples) * np.sqrt(share))


def _passed(f: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """Share of the power at ``f`` [Hz] that a fourth-order Butterworth filter run both ways lets through."""
    if cutoff_hz >= 0.5 * rate_hz:
        return np.ones_like(f)
    warped = np.tan(np.pi * np.minimum(f, 0.4999 * rate_hz) / rate_hz) / np.tan(np.pi * cutoff_hz / rate_hz)
    return 1.0 / (1.0 + warped**8) ** 2
