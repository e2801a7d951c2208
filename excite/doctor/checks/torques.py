"""Torques that mean something else than the log says: too weak to be torques, or of the other side of the gear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.display import span
from excite.doctor.channel_errors import misreadings
from excite.doctor.channel_mapping import Reading
from excite.doctor.check import Check, Outcome
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.torques import TORQUE_SCALE, ModelParts, parts_in
from excite.doctor.model_comparison import drive_fit
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.errors import LogError
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.regressor.contact_forces import motor_regressor, motor_torques
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS, JointSamples
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.saturation import flags_at
from excite.rows.settings import ProblemSettings

# Nominal masses would have to be five times too large.
_WEAK = 0.2
# And no likely body, friction or rotor explains more than a fifth of the torque's power.
_UNEXPLAINED = 0.8
_DRIVE_SHARE = 0.15
_ROTOR_SHARE = 0.3
# A model without bodies says nothing of rotors beside them [kg·m²].
_WEIGHTLESS = 1e-7


class WeakTorques(Check):
    """Torques far below what the nominal masses need, of some joints or of most."""

    kinds = ("weak_torque", "torque_scale")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        samples = _samples(robot, log)
        if samples is None:
            return Outcome(log)
        reading = Reading.as_stated(log)
        parts = None if log.header.torque == "current" else of_unknown_unit(samples, reading)
        if parts is not None:
            return Outcome(log, (said_of_unit(samples, parts, reading),), frozenset({Doubt.SIZE}))
        gains, _ = samples.gains(reading)
        weak = (samples.judged(reading).left > 0.5 * np.log(_UNEXPLAINED)) & (np.abs(gains) < _WEAK)
        # What a spring or a cable takes hides the bodies' torque and is large; what a dead channel reads is small.
        read, needed = samples.measured_torque(reading).std(axis=0), samples.predicted(reading)[0].std(axis=0)
        weak &= read < _WEAK * needed
        # A torque that is cut off is weaker than it was.
        weak &= ~np.array([_cut_off(log, name) for name in samples.channels], dtype=np.bool_)
        if not weak.any() or 2 * weak.sum() > len(weak):
            return Outcome(log)
        names = tuple(name for name, flag in zip(samples.channels, weak, strict=True) if flag)
        text = (
            f"torques of {list_names(names)} are at most {max(float(gains[weak].max()), 0.0):.2g} "
            "times what the nominal "
            "masses need, unlike the others: a dead channel, or another unit"
        )
        finding = Finding(
            "weak_torque",
            text,
            {"joints": float(len(names))},
            names,
            severity="spoils",
            sure=0.8,
            repaired=True,
            remedy="they are taken as no_torque; name them there, or correct the unit",
        )
        header = log.header.model_copy(update={"no_torque": (*log.header.no_torque, *names)})
        return Outcome(replace(log, header=header), (finding,))


def _cut_off(log: Log, joint: str) -> bool:
    j = log.header.joints.index(joint)
    return any(trial.beyond is not None and trial.beyond[:, j].any() for trial in log.trials)


class TorqueSide(Check):
    """Torques called link-side that hold the rotors' inertia or the gears' friction.

    Rotors show at the outer joints, which carry little else.
    """

    kinds = ("torque_side",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        samples = _samples(robot, log)
        if samples is None or log.header.torque != "link_side":
            return Outcome(log)
        outer, rubbing = _rotors(samples, Reading.as_stated(log))
        joints = samples.channels
        # Friction alone is seen behind the gear too, in bearings and seals; inertia that is negative is no rotor's.
        if outer < (0.0 if 2 * rubbing > len(joints) else _ROTOR_SHARE):
            return Outcome(log)
        text = (
            f"torques are called link_side, yet they hold rotor inertia ({outer:.2g} times the links' own at the outer "
            f"joints) and friction ({rubbing} joints): they look motor-side"
        )
        finding = Finding(
            "torque_side",
            text,
            {"rotor_share": outer, "joints": float(rubbing)},
            joints,
            severity="spoils",
            sure=0.8,
            remedy="write torque: motor_side, or friction and rotors go into the links",
        )
        return Outcome(log, (finding,))


def _samples(robot: Robot, log: Log) -> TorqueSamples | None:
    if log.header.free_base or log.header.torque in {None, "none"}:
        return None
    return torque_samples(robot, log)


def _rotors(samples: TorqueSamples, reading: Reading) -> tuple[float, int]:
    """Rotor inertia at the outer joints, as share of the links', and the number of joints that rub."""
    model, drive = samples.predicted(reading)
    torque, own = samples.measured_torque(reading), _own_inertia(samples)
    rotors, rubbing = [], 0
    for j in np.flatnonzero(own > _WEIGHTLESS):
        weights, friction = drive_fit(torque[:, j], model[:, j], drive.v[:, j], drive.a[:, j])
        rotors.append(weights[-1] / max(float(own[j]), 1e-12))
        moving = torque[:, j] - torque[:, j].mean()
        rubbing += float(friction @ friction) > _DRIVE_SHARE * float(moving @ moving)
    return float(np.median(rotors[-max(1, len(rotors) // 2) :])) if rotors else 0.0, int(rubbing)


def _own_inertia(samples: TorqueSamples) -> Array:
    """Mean inertia that each measured joint has by the nominal model, ``(n_torques,)``: torque per acceleration."""
    some = slice(None, None, max(1, len(samples.q) // 20))
    q, rest = samples.q[some], np.zeros_like(samples.v[some])
    model, found = samples.robot.model, []
    still = inverse_dynamics(model, q, rest, rest)
    for place in samples.places[samples.measured]:
        push = rest.copy()
        push[:, place] = 1.0
        turned = inverse_dynamics(model, q, rest, push)
        found.append(float(np.mean((turned - still)[:, place])))
    return np.array(found)


# Torques that hold next to nothing of the nominal bodies: in an unknown unit, or with the model taken off.

# Of 15 logs in N·m, most of real machines and with whatever loads, the torques of most joints vary by 0.6 to 20 times
# what the nominal bodies need, or by a quarter (a double pendulum that swings by itself); those of a KUKA KR 300 before
# its gears by a hundredth where the bodies are heavy.
_TOO_SMALL = 0.1


def of_unknown_unit(samples: TorqueSamples, reading: Reading) -> ModelParts | None:
    """What torques hold of the nominal bodies where that is next to nothing, and no factor tells their unit.

    Friction hides the factor, and whatever else such torques seem to betray is friction's, too. Joints that need most
    of the robot's torque have to tell so, more than one of them: of a joint alone it may be a motion that needs no
    torque, as a pendulum swings.
    """
    parts = parts_in(samples, reading)
    needed = samples.predicted(reading).torque.std(axis=0)
    if parts.told.sum() < 2 or needed[parts.told].sum() <= 0.5 * needed.sum() or parts.largest > _TOO_SMALL:
        return None
    return None if misreadings(samples, reading, (TORQUE_SCALE,))[1] else parts


def said_of_unit(samples: TorqueSamples, parts: ModelParts, reading: Reading) -> Finding:
    """What is said of such torques."""
    gains, _ = samples.gains(reading)
    ratios = np.sort(1.0 / gains[parts.told & (gains > 0.0)])
    gears = ""
    if len(ratios):
        gears = (
            f" of about {span(f'{ratios[0]:.0f}', f'{ratios[-1]:.0f}', ' to ')} to 1 by the nominal masses"
        )
    text = (
        f"torques hold next to nothing of what the nominal masses need ({parts.said()}): they are torques before "
        f"gears{gears}, currents, another unit, or external torques, off which a driver has taken the model"
    )
    factors = ", ".join(f"tau.{joint}: RATIO" for joint in samples.channels[:2])
    return Finding(
        "torque_scale",
        text,
        parts.figures(),
        samples.channels,
        severity="spoils",
        remedy=f"state the joints' gear ratios or torque constants (scale: {{{factors}, …}} in map.yaml), or log "
        "torques as measured; what follows is in the log's unit, and no weight",
    )


# Torques at an end of their range: left out where they say less than there was, kept where the drive gave no
# more.

# Deviations of what the model leaves elsewhere by which the motion asks for more than the rail, up to which it agrees
# with it. Of UR10, Panda and iiwa with nothing hidden, a payload or a spring, torques of drives at their limits were
# -0.7 to 1.2, those clipped in 2 % of the rows 2.7 to 57 and in more of them more.
_AGREES = 1.75
# Share of a torque's samples within its range from which it says something of its joint: with 6 % of them a UR10's
# payload had its mass to 1 %, and with fewer the filter leaves next to no rows.
_TORQUE_RANGE_LEAST = 0.05


class TorqueRange(Check):
    """Torques, or currents, at the largest or smallest value that they have."""

    kinds = ("clipped", "drive_limit")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        rows = {joint: _marked(log, joint) for joint in log.header.torque_joints}
        rows = {joint: count for joint, count in rows.items() if count}
        if not rows:
            return Outcome(log)
        told = not log.header.free_base and robot.mechanism is None and not log.header.coupling
        beyond = {joint: torque_overshoot(robot, log, joint) if told else None for joint in rows}
        held = [joint for joint, times in beyond.items() if times is not None and times <= _AGREES]
        lost = [joint for joint in rows if joint not in held]
        marked, log = log, replace(log, trials=tuple(_without(trial, log, held) for trial in log.trials))
        samples = sum(len(trial.time) for trial in log.trials)
        silent = [joint for joint in lost if samples - rows[joint] < _TORQUE_RANGE_LEAST * samples]
        kind, findings = kind_of_torque(log), []
        if held:
            said = list_names([f"{kind}.{joint} in {rows[joint]} rows" for joint in held])
            findings.append(
                Finding(
                    "drive_limit",
                    f"{said}: at the drive's limit, as the motion agrees with no more torque",
                    {"rows": float(sum(rows[joint] for joint in held))},
                    tuple(f"{kind}.{joint}" for joint in held),
                    remedy="nothing: these rows are as good as others",
                    trials=_trials(marked, held),
                )
            )
        for joints, taken in ((lost, False), (silent, True)):
            joints = [joint for joint in joints if taken or joint not in silent]
            if not joints:
                continue
            said = list_names([f"{kind}.{joint} in {rows[joint]} of {samples} rows" for joint in joints])
            how = "they are taken as no_torque" if taken else "these rows of their joints are left out"
            findings.append(
                Finding(
                    "clipped",
                    f"{said}: clipped at the sensor's range, as the torque was larger than that; {how}",
                    {"rows": float(sum(rows[joint] for joint in joints))},
                    tuple(f"{kind}.{joint}" for joint in joints),
                    severity="limits",
                    remedy="move slower or carry less, or raise the range; what lies beyond is lost",
                    trials=_trials(marked, joints),
                )
            )
        if silent:
            header = log.header.model_copy(update={"no_torque": (*log.header.no_torque, *silent)})
            log = replace(log, header=header)
        return Outcome(log, tuple(findings))


def _column(log: Log, joint: str) -> int:
    return log.header.joints.index(joint)


def _marked(log: Log, joint: str) -> int:
    """Rows in which a joint's torque is at an end of its range."""
    j = _column(log, joint)
    return sum(int(trial.beyond[:, j].sum()) for trial in log.trials if trial.beyond is not None)


def _trials(log: Log, joints: list[str]) -> tuple[str, ...]:
    columns = [_column(log, joint) for joint in joints]
    return tuple(t.name for t in log.trials if t.beyond is not None and t.beyond[:, columns].any())


def _without(trial: Trial, log: Log, joints: list[str]) -> Trial:
    """The trial with the marks of some joints taken off."""
    if trial.beyond is None or not joints:
        return trial
    flags = trial.beyond.copy()
    flags[:, [_column(log, joint) for joint in joints]] = False
    return replace(trial, beyond=flags if flags.any() else None)


# Torques at an end of their range: where they are, and whether the motion says that they were no larger.

# Samples that a joint's row is fitted to: some thousand tell it as well as all. Fewer than the least tell nothing.
_SAMPLES, _LEAST = 3000, 100
_TERMS = ("viscous", "coulomb", "offset", "armature")
# Coefficients are held to the nominal ones by this share of their columns' power, or two that the motion does not tell
# apart would run away where the torque is large.
_HELD = 1e-4


def kind_of_torque(log: Log) -> str:
    """First part of the names of the log's torques or currents."""
    return "i" if log.header.torque == "current" else "tau"


def at_rails(log: Log) -> Log:
    """The log with its trials' samples marked in which a torque or current is at an end of its range.

    A trial that reaches the end at which another one is clipped is at it too.
    """
    kind, rails = kind_of_torque(log), set[tuple[int, float]]()
    for trial in log.trials:
        values = _trial_torques(trial)
        for j, joint in enumerate(log.header.joints):
            count = trial.cleaning.clipped.get(f"{kind}.{joint}", 0)
            if values is None or not count:
                continue
            # The channel was found to be clipped at one end or both; at an end that it is not it stays a moment.
            ends = {
                float(end): int((values[:, j] == end).sum())
                for end in (values[:, j].min(), values[:, j].max())
            }
            rails |= {(j, end) for end, often in ends.items() if 4 * often >= count}
    return replace(log, trials=tuple(_mark_rails(trial, rails) for trial in log.trials)) if rails else log


def _mark_rails(trial: Trial, rails: set[tuple[int, float]]) -> Trial:
    values = _trial_torques(trial)
    if values is None:
        return trial
    flags = np.zeros(values.shape, dtype=np.bool_)
    for j, rail in rails:
        flags[:, j] |= values[:, j] == rail
    return replace(trial, beyond=flags) if flags.any() else trial


def _trial_torques(trial: Trial) -> Array | None:
    return trial.tau if trial.tau is not None else trial.current


def torque_overshoot(robot: Robot, log: Log, joint: str) -> float | None:
    """How far beyond its rail a joint's torque should be by the motion, in deviations of what is left elsewhere.

    A drive at its limit gives no more than it says, and the motion is what that torque makes of it; a sensor or an
    estimate at the end of its range says less than there is. The joint's own row of the equations, with its bodies,
    friction and rotor, is fitted where the torque is within its range and predicts the rest.

    Args:
        robot: the nominal model.
        log: the log, its trials marked.
        joint: one of its joints that has a torque.

    Returns:
        Mean over the samples at the rail; None where the log does not tell.
    """
    robot, settings = robot_in_log(robot, log.header, log.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    column, place = log.header.joints.index(joint), robot.n_base_v + robot.joint_index(joint)
    rows, rests, marked, torques = [], [], [], []
    for trial in log.trials:
        values = _trial_torques(trial)
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
        except LogError:
            continue
        if values is None:
            continue
        here = np.flatnonzero(k.in_motion)
        here = here[:: max(1, len(log.trials) * len(here) // _SAMPLES)]
        q, v, a = k.q[here], k.v[here], k.a[here]
        samples = JointSamples(robot, q, v, a, [place], settings.coulomb_width, None)
        drives = np.concatenate([DRIVE_TERMS[term].columns(samples) for term in _TERMS], axis=2)[:, 0]
        rows.append(np.hstack([motor_regressor(robot, q, v, a)[:, place], drives]))
        torque = forces_on_grid(trial.time, values[:, [column]], k.time)[here, 0]
        torques.append(torque)
        rests.append(torque - motor_torques(robot, q, v, a)[:, place])
        flags = np.zeros_like(values, dtype=np.bool_) if trial.beyond is None else trial.beyond
        marked.append(flags_at(trial.time, flags[:, [column]], k.time)[here, 0])
    if not rows:
        return None
    x, y, at = np.concatenate(rows), np.concatenate(rests), np.concatenate(marked)
    if (~at).sum() < _LEAST or not at.any():
        return None
    scale = np.maximum(np.linalg.norm(x[~at], axis=0), 1e-9)
    x = x / scale
    weights = np.linalg.solve(x[~at].T @ x[~at] + _HELD * np.eye(len(scale)), x[~at].T @ y[~at])
    left = y - x @ weights
    measured = np.concatenate(torques)
    outwards = np.sign(measured[at] - np.median(measured[~at]))
    deviation = float(np.sqrt((left[~at] ** 2).mean()))
    return -float((outwards * left[at]).mean()) / max(deviation, 1e-300)
