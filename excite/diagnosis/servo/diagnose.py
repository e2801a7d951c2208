"""The diagnosis of a log without torque: what its servo must have asked for, and closed-loop simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis, NextExperiment, Rollout
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.answer.gap import ChannelGap, Gap, find_beaten_channels, share_closed
from excite.diagnosis.arm.diagnose import diagnose_arm, diagnose_torques
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.attribution import STRUCTURED, Attribution
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Context, Form, Sizes
from excite.diagnosis.effects.readings import EncoderOffset, TimeDelay, TorqueGain
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.servo.gains import estimate_gains, known_servo
from excite.diagnosis.servo.servo import (
    EXACT,
    ClosedLoop,
    RolloutAgreement,
    Servo,
    ServoRecord,
    cycle_lag,
    read_signals,
    roll_out,
    servo_floor,
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
# Effects that leave more of every joint's roll-out error are not confirmed, nor are those that make it worse.
_CONFIRMS = 0.95


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
        return _diagnose_asked(robot, log, rng, out)
    joints = log.header.joints
    trials = tuple(_resample_evenly(log, t) for t in log.trials)
    controller = _controllers_model(log)
    signals = {t.name: read_signals(robot, log, t, controller) for t in trials}
    servo = known_servo(robot, log, {t.name: signals[t.name] for t in trials if t.role == "identification"})
    # A wrong scale of a joint's torques is its gain's where that was estimated.
    guessed = (TorqueGain.name,) if any(name.startswith("kp of") for name in servo.estimated) else ()
    modelled = (*log.header.modelled, *_CHANNEL, *guessed)
    asked = tuple(replace(t, tau=signals[t.name].servo_torque(servo)) for t in trials)
    samples = arm_samples(robot, log, asked)
    lag = cycle_lag(samples, modelled)
    acting = tuple(replace(t, tau=signals[t.name].acting_torque(servo, lag)) for t in trials)
    commands = ServoRecord(servo, signals, lag, {t.name: t for t in trials}, joints)
    loops: list[ClosedLoop] = []

    def simulate_loop(attribution: Attribution) -> Rollout:
        loops.append(roll_out(commands, attribution, out))
        return loops[0].rollout

    record = TorqueRecord(
        robot,
        replace(log, trials=acting),
        modelled,
        out,
        lambda samples: servo_floor(samples, servo, commands.joint_order(samples)),
        servo_effects(servo, joints),
    )
    found = _judge_rollouts(diagnose_torques(record, rng, simulate_loop), commands, loops[0])
    # What simple predictors of the positions reach on the same rows.
    rolled = loops[0].rollout.after or None
    floor = {name: c.noise_floor for name, c in found.gap.per_channel.items()} if rolled else {}
    errors = of_positions(robot, log, tuple(found.gap.per_channel), loops[0].spans, rolled, floor)
    faults = (*found.faults, *find_beaten_channels(errors))
    return replace(
        found, absorbed=(*estimate_gains(robot, log, servo), *found.absorbed), trivial=errors, faults=faults
    )


def _controllers_model(log: Log) -> Robot | None:
    """The robot that the log names: what the servo knew, whichever model the diagnosis starts from."""
    try:
        return None if log.folder is None else nominal_robot(log)
    except (LogError, RobotError):
        # One that is handed over in the place of a robot that is not there is all that is known of it.
        return None


def _diagnose_asked(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None) -> Diagnosis:
    """The diagnosis from commanded torques."""
    header = log.header.model_copy(update={"torque": "motor_side"})
    trials = tuple(replace(trial, tau=trial.tau_cmd, tau_cmd=None) for trial in log.trials)
    result = diagnose_arm(robot, replace(log, header=header, trials=trials), rng, out)
    said = (
        "torques are tau_cmd, what was asked of the drives: a torque_gain or torque_bias is the drive's own"
    )
    return replace(result, warnings=(*result.warnings, said))


def _resample_evenly(log: Log, trial: Trial) -> Trial:
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


# The verdict after the roll-outs.


def _judge_rollouts(result: Diagnosis, record: ServoRecord, closed: ClosedLoop) -> Diagnosis:
    """The verdict after the roll-outs, with the gap in positions and what no torque leaves open."""
    servo, rollout = record.servo, closed.rollout
    said = [
        "the log has no torque: an error of a torque sensor cannot be seen, and where friction ends and the "
        "drive's own losses begin cannot be told"
    ]
    if record.lag > 0.0:
        said.append(
            f"torques act {1e3 * record.lag:.1f} ms after commands and positions ask for them, taken for the "
            "servo's cycle: a lag of the drive that is as short cannot be seen"
        )
    said += closed.sentences
    if servo.estimated:
        said.append(
            "not stated and estimated with the nominal masses for a scale: "
            + ", ".join(servo.estimated)
            + "; gains are told far better where controller in log.yaml states the feedforward, such as none"
            * ("the feedforward" in servo.estimated)
        )
    if not servo.follows_velocity and any(name.startswith("kd of") for name in servo.estimated):
        said.append(
            "the servo brakes the velocity itself by damping that is not stated: viscous friction is within it"
        )
    result = replace(result, warnings=(*result.warnings, *said))
    if not rollout.before:
        return result
    gap = position_gap(rollout, closed.deviation, closed.floor)
    unexplained = joints_above_noise(closed.structured, gap)
    few = result.effects[: max(closed.kept, 1)]
    faint = closed.strength < EXACT
    if result.effects and (faint or not is_confirmed(gap, closed.witness)):
        named = " and ".join(f"{e.effect} at {e.location}" for e in result.effects)
        but = (
            f"torques rebuilt from a servo are no more exact than its {100 * closed.strength:.1f} % of them"
            if faint
            else "closed-loop roll-outs do not confirm it"
        )
        # What is no gap without an effect so faint is none with it.
        silent = faint and not unexplained
        return replace(
            result,
            warnings=(*result.warnings, f"the servo's torques speak for {named}, {but}"),
            gap=gap,
            verdict="none" if silent else "unknown",
            location=None if silent else result.location,
            effect=None,
            effects=(),
            tied_locations=(),
            n_tied=0,
            next_experiment=None,
        )
    if result.verdict in {"effect", "ambiguous"}:
        # A further effect that roll-outs know nothing of is one of the servo that was taken for another.
        result = replace(result, gap=gap, effects=few)
        guessed = any(name.startswith(("kp of", "kd of")) for name in servo.estimated)
        return mark_twins(result, guessed, closed.delay) if result.verdict == "effect" else result
    if result.verdict == "unknown" and result.location in closed.structured:
        # Where positions show no gap, what torques made of them call clear is the encoders' noise.
        if unexplained:
            return replace(result, gap=gap, location=unexplained[0], effects=few)
        gap = position_gap(replace(rollout, after=rollout.before), closed.deviation, closed.floor)
        return replace(result, gap=gap, verdict="none", location=None, effects=())
    return replace(result, gap=gap)


def is_confirmed(gap: Gap, said: RolloutAgreement | None = None) -> bool:
    """Whether roll-outs are clearly nearer to the record, or at least do not speak against the effects.

    Nearer is on some joint, and no further in all. What the encoders' noise has of the error, no simulator takes
    away.

    Args:
        gap: of roll-outs with the effects that help.
        said: by all effects' change of the roll-outs.
    """
    if said is not None and not said.is_contradicting:
        return True
    return gap.after <= gap.before and any(
        max(c.after**2 - c.noise_floor**2, 0.0) < _CONFIRMS**2 * (c.before**2 - c.noise_floor**2)
        for c in gap.per_channel.values()
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
    parts = np.array([before, after, np.minimum(floor, np.minimum(before, after))])
    whole = [float(x) for x in np.sqrt(np.mean((parts / deviation) ** 2, axis=1))]
    channels = {n: ChannelGap(b, a, f, "rad") for n, (b, a, f) in zip(names, parts.T.tolist(), strict=True)}
    return Gap(whole[0], whole[1], whole[2], share_closed(*whole), channels)


def joints_above_noise(joints: Sequence[str], gap: Gap) -> tuple[str, ...]:
    """Those of some joints whose roll-outs are off by more than the noise of the positions that they are held against.

    What torques leave there else, a servo that stiff, or encoders that coarse, hide in the positions; the torques are
    made of the same positions.

    Args:
        joints: with a rest of their torques that is no noise.
        gap: of roll-outs.
    """
    known = {j: gap.per_channel[j] for j in joints if j in gap.per_channel}
    return tuple(j for j, c in known.items() if c.after**2 > STRUCTURED * c.noise_floor**2)


def mark_twins(result: Diagnosis, estimated: bool, delay: Estimate | None = None) -> Diagnosis:
    """Ambiguous where another name means the same without torque.

    Args:
        result: the diagnosis.
        estimated: whether gains were estimated: inertia and braking that a joint lacks, or has too
            much, are a wrong gain then.
        delay: what a delay in the place of a lag would be; None where it would be none.
    """
    first = result.effects[0]
    effect = EFFECTS[first.effect]
    twins = [replace(first, effect=name) for name in (effect.twins_of_a_gain if estimated else ())]
    for name in effect.twins_without_torque:
        if name != TimeDelay.name:
            twins.append(replace(first, effect=name))
        elif delay is not None:
            twins.append(replace(first, effect=name, parameters={"delay": delay}))
    if not twins:
        return result
    rest = tuple(c for c in result.candidates if (c.effect, c.location) != (first.effect, first.location))
    tied = (first, *twins)
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
            for k, change in enumerate(self._gravity_change(context, j, math.log(theta[0])).T):
                columns[k][:, 0] += change
        return Shape(columns)

    def _gravity_change(self, context: Context, j: int, secant: float) -> Array:
        """Change of the nominal weight from the true to the logged position, per offset, ``(n_samples, n_joints)``."""
        samples = context.baseline.samples
        step = secant if abs(secant) > _SMALL else _SMALL
        here = samples.stack_trials("q")
        there = here.copy()
        there[:, samples.index[j]] -= step
        still = np.zeros((len(here), samples.robot.model.nv))
        old, new = (inverse_dynamics(samples.robot.model, q, still, still) for q in (here, there))
        return np.asarray((old - new)[:, list(samples.index)] / step)

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        found = super().to_estimates(context, location, theta, fit)
        return found | {"in_log_only": found["offset"]}

    def in_mujoco(self, item: Sizes) -> Form:
        return replace(super().in_mujoco(item), notes=(self.make_note(item),))


class FollowedOffset(EncoderOffset):
    """An offset that the servo follows; one of the log alone is another form of it."""

    def __init__(self, kp: Mapping[str, float], feedforward: str):
        self._logged = LoggedOffset(kp, feedforward)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (self._logged,)


def servo_effects(servo: Servo, joints: tuple[str, ...]) -> tuple[Effect, ...]:
    """The library of effects as a servo's log shows them.

    Args:
        joints: of the log, in the servo's order.
    """
    kp = dict(zip(joints, servo.kp.tolist(), strict=True))
    followed = FollowedOffset(kp, servo.feedforward)
    return tuple((EFFECTS | {followed.name: followed}).values())
