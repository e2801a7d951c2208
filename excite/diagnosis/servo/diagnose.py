"""The diagnosis of a log without torque: what its servo must have asked for, and closed-loop simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.absorbed import Absorbed, estimated_gains
from excite.diagnosis.answer.result import Diagnosis
from excite.diagnosis.answer.trivial import beaten
from excite.diagnosis.arm.diagnose import diagnose_arm, diagnose_torques
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.effects.readings.torque_gain import TorqueGain
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.closed_loop import ClosedLoop
from excite.diagnosis.servo.confirmation import above_noise, confirmed, position_gap, with_twin
from excite.diagnosis.servo.cycle import acting, servo_cycle
from excite.diagnosis.servo.encoders import servo_effects
from excite.diagnosis.servo.gains import known_servo
from excite.diagnosis.servo.levels import error_integral, trial_levels
from excite.diagnosis.servo.noise import servo_floor
from excite.diagnosis.servo.servo import Servo, Signals, read_signals
from excite.diagnosis.servo.strength import EXACT
from excite.diagnosis.trivial.neighbours import of_positions
from excite.errors import LogError, RobotError
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.resample import is_uniform, resample_smooth, uniform_grid
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
