"""Why a policy shakes, drifts or falls: what of a robot that walks is not as its simulator has it.

Three equations that do not know the forces at the feet: the servos' law (:mod:`excite.diagnosis.walking.servos`), the
limbs' rows (:mod:`excite.diagnosis.walking.limbs`), and the feet's, which stand still against each other while they
carry.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array, distinct_rows, widen_flags
from excite.diagnosis.answer.answer import Absorbed, Diagnosis, NextExperiment, Verdict
from excite.diagnosis.answer.candidate import Candidate, Estimate, RobotChanges
from excite.diagnosis.answer.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.servo.gains import stated_servo
from excite.diagnosis.walking.kinds import JITTER, LATE_IMU, OF_COMMANDS, ORDER, SLIP, SURE, TURNED
from excite.diagnosis.walking.limbs import Limbs
from excite.diagnosis.walking.servos import CUTOFF_HZ, Servo, command_ticks, read_servos, servo_effects
from excite.errors import LogError
from excite.finding import list_names
from excite.logs.log import Log, Trial
from excite.regressor.contact_forces import contact_maps
from excite.robot.robot import Robot
from excite.rows.joint_rows import CHANGE_S, closed_on_grid
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings

# Contacts that change more often than this are steps: a trot changes sixteen a second, a foot moved alone one in three.
_STEPS_HZ = 2.0


def walks(log: Log) -> bool:
    """Whether a log is of a robot that steps, whose contact forces nobody measures; moving foot by foot is standing."""
    if log.header.base != "floating" or log.header.sensors:
        return False
    steps = sum(int((flags[1:] != flags[:-1]).sum()) for t in log.trials for flags in t.contacts.values())
    return steps > _STEPS_HZ * sum(float(t.time[-1] - t.time[0]) for t in log.trials)


def diagnose_walking(robot: Robot, log: Log) -> Diagnosis:
    """Diagnose a robot that walks, from commands, positions, torques, IMU and contact flags.

    Args:
        robot: the nominal model.
        log: the log; without torques the servo's gains have to be stated, and torques are what it asks for.

    Returns:
        The diagnosis; channels are joints.

    Raises:
        LogError: what the log has tells nothing of drives.
    """
    servos = tuple(read_servos(log)) if log.header.torque in {"motor_side", "link_side"} else ()
    if log.header.torque == "none":
        log = _with_asked_torques(log)
    cutoff = min(CUTOFF_HZ, 0.2 * log.header.rate_hz)
    limbs = Limbs.of(robot, log, cutoff)
    others = (*servo_effects(robot, log, servos), *_foot_effects(limbs.problem.robot, log, cutoff))
    effects = tuple(sorted([*others, *limbs.effects()], key=lambda one: -one.evidence))
    rivals = tuple(limbs.rivals())
    at_servos = any(one.effect in OF_COMMANDS for one in effects)
    gap = _with_servos(limbs.gap, servos) if at_servos else limbs.gap
    first, untold = effects[0] if effects else None, list(_untold(log, servos, effects, rivals))
    verdict: Verdict = "none"
    if first is not None:
        verdict = "ambiguous" if rivals and first.effect not in {*OF_COMMANDS, SLIP.effect} else "effect"
    elif any(not servo.follows for servo in servos):
        verdict = "unknown"
    return Diagnosis(
        robot=robot.name,
        verdict=verdict,
        effect=first.effect if first else None,
        location=first.location if first else None,
        tied_locations=first.tied_locations if first else (),
        candidates=(*effects[:1], *rivals, *effects[1:]),
        effects=effects,
        gap=gap,
        where=limbs.where(),
        n_tied=1 + len(rivals) if verdict == "ambiguous" else 0,
        next_experiment=untold[0] if untold else None,
        warnings=(*_limits(log, servos, effects), *(f"not told: {one.why}" for one in untold[1:])),
        absorbed=tuple(_told_of_servos(servos)),
        changes=tuple(_changes(effects[:k]) for k in range(len(effects) + 1)),
    )


def _changes(effects: Sequence[Candidate]) -> RobotChanges:
    """Friction into the robot's description, beside what it has; the rest has no place there."""
    sizes = {(one.effect, one.location or ""): next(iter(one.parameters.values())).value for one in effects}
    viscous, coulomb = (
        {joint: value for (effect, joint), value in sizes.items() if effect == name}
        for name in ("viscous_friction", "coulomb_friction")
    )
    rest = tuple(
        f"{effect} at {joint}: {value:.4g}"
        for (effect, joint), value in sizes.items()
        if "friction" not in effect
    )
    return RobotChanges(viscous, coulomb, beyond=rest)


def _with_asked_torques(log: Log) -> Log:
    """The log with the torques that the stated servo asks for; raises LogError."""
    servo = stated_servo(log.header.controller, log.header.joints)
    if np.isnan([*servo.kp, *servo.kd]).any():
        raise LogError(
            "neither torques nor the servo's gains are known",
            field="controller",
            remedy="state kp and kd of the policy's servos, or log their torque estimates as tau.*",
        )

    def asked(trial: Trial) -> Trial:
        if trial.q_cmd is None:
            raise LogError("has no commands", source=trial.name, field="q_cmd", remedy="log q_cmd.*")
        v = np.gradient(trial.q, trial.time, axis=0) if trial.v is None else trial.v
        return replace(trial, tau=servo.kp * (trial.q_cmd - trial.q) - servo.kd * v)

    header = log.header.model_copy(update={"torque": "motor_side"})
    return replace(log, header=header, trials=tuple(asked(t) for t in log.trials))


def _with_servos(gap: Gap, servos: Sequence[Servo]) -> Gap:
    """The gap with a channel ``JOINT.servo`` for each servo: its torque beside what the stated law asks for."""
    follow = [servo for servo in servos if servo.follows]
    parts = np.array([np.array(servo.gap[:2]) / max(servo.gap[2], 1e-12) for servo in follow]) ** 2
    old, n = np.array([gap.before, gap.after, gap.noise_floor]) ** 2, len(gap.per_channel)
    added = np.array([parts[:, 0].sum(), parts[:, 1].sum(), parts[:, 1].sum()])
    before, after, floor = (float(x) for x in np.sqrt((n * old + added) / (n + len(follow))))
    channels = {
        f"{servo.joint}.servo": ChannelGap(servo.gap[0], servo.gap[1], servo.gap[1]) for servo in follow
    }
    whole = {**gap.per_channel, **channels}
    return Gap(before, after, floor, share_closed(before, after, floor), whole)


def _told_of_servos(servos: Sequence[Servo]) -> Iterator[Absorbed]:
    for servo in servos:
        sizes, stds = servo.sizes(np.ones(2))
        for k, name, unit in ((0, "kp", "N·m/rad"), (1, "kd", "N·m·s/rad"), (4, "command_delay", "s")):
            value, std = float(sizes[k]), float(stds[k])
            between = (value - 1.645 * std, value + 1.645 * std)
            yield Absorbed(servo.joint, name, Estimate(value, std, unit), between)


def _limits(log: Log, servos: Sequence[Servo], effects: Sequence[Candidate]) -> Iterator[str]:
    """What limits the answer, but for what another recording would tell."""
    for one in effects:
        if one.effect == ORDER.effect:
            command = log.header.joints[round(one.parameters[ORDER.parameter].value)]
            yield (
                f"the torque of {one.location} follows the command of {command}: "
                "the policy and the robot order their joints differently, or two cables are exchanged"
            )
    for servo in servos:
        if not servo.follows:
            yield (
                f"{100 * servo.explained:.0f} % of the torque of {servo.joint} follows a servo's law of a command: "
                "a feedforward, or gains that change"
            )
        if np.isfinite(servo.limit):
            yield f"the torque of {servo.joint} is cut at {servo.limit:.3g} for {100 * servo.cut:.1f} % of the time"
    if log.header.imu is None:
        yield "no IMU: the base's motion is that of its pose, differentiated twice"


def _untold(
    log: Log, servos: Sequence[Servo], effects: Sequence[Candidate], rivals: Sequence[Candidate]
) -> Iterator[NextExperiment]:
    """What this walk cannot tell, and which seconds would."""
    joints = dict.fromkeys(
        str(one.location) for one in (*effects[:1], *rivals) if rivals and one.location in log.header.joints
    )
    if rivals:
        swung = f"{list_names(list(joints))} alone swings" if joints else "its trunk is tilted by hand"
        yield NextExperiment(
            f"what could stand in the place of the first effect is told by ten seconds in which {swung}, slowly and "
            "fast, the robot hung up (base: suspended)",
            tuple(f"{one.effect}@{one.location}" for one in rivals),
        )
    tied = [one for one in effects if len(one.tied_locations) > 1]
    if tied:
        yield NextExperiment(
            "which of the feet slips is told by ten seconds in which the robot stands on all feet and leans about",
            tuple(f"{one.effect}@{one.location}" for one in tied),
        )
    if not servos:
        yield NextExperiment(
            "whether gains are applied and commands late is told by a walk with q_cmd.* and tau.* logged",
            tuple(sorted(OF_COMMANDS)),
        )
    elif not all(len(command_ticks(trial)) for trial in log.trials):
        yield NextExperiment(
            "jitter of the commands is told by ten seconds logged at several times the policy's rate, q_cmd.* as sent",
            (JITTER.effect,),
        )
    if any(trial.imu is None for trial in log.trials):
        yield NextExperiment(
            "mounting and delay of the IMU are told by ten seconds of walking and turning with imu.* logged",
            (TURNED.effect, LATE_IMU.effect),
        )


# Feet that carry stand still against each other: where one does not, it slips.
#
# What contact points move by, ``Jᵀ [0; ω; q̇]``, is known up to the trunk's linear velocity, which all share. Of three
# and more the one that moves against the others slips; of two that carry alone either may.

# Of a simulated trot on a floor of friction 0.6 feet that carry move by less for 97 % of the time [m/s]: they roll, and
# touch and leave.
_SLIDES = 0.15
_STRETCHES = 10


def _foot_effects(robot: Robot, log: Log, cutoff_hz: float) -> Iterator[Candidate]:
    """Feet that slip for a larger share of the time in which they carry than the others do, or all of them.

    Args:
        robot: the nominal model.
        log: its log.
        cutoff_hz: of the filter of positions.
    """
    names = [foot.name for foot in robot.feet]
    speed = np.concatenate([_speeds(robot, log, trial, cutoff_hz) for trial in log.trials])
    parts = [part for part in np.array_split(speed, _STRETCHES) if (~np.isnan(part)).any(axis=0).all()]
    if len(names) < 2 or len(parts) < _STRETCHES // 2:
        return
    shares = np.array(
        [np.nanmean(np.where(np.isnan(part), np.nan, part > _SLIDES), axis=0) for part in parts]
    )
    share, std = shares.mean(axis=0), shares.std(axis=0) / np.sqrt(len(shares)) + 1e-3
    usual = float(np.median(share))
    if usual > SLIP.least:
        yield SLIP.candidate("feet", usual, float(np.median(std)))
    clear = share - usual > np.maximum(SLIP.least, SURE * std)
    for k in np.flatnonzero(clear):
        alike = tuple(name for i, name in enumerate(names) if clear[i] and abs(share[i] - share[k]) < std[k])
        fast = Estimate(float(np.nanmedian(speed[speed[:, k] > _SLIDES, k])), None, "m/s")
        named = SLIP.candidate(names[k], share[k], std[k], usual=usual)
        yield replace(named, parameters={**named.parameters, "speed": fast}, tied_locations=alike)


def _speeds(robot: Robot, log: Log, trial: Trial, cutoff_hz: float) -> Array:
    """Speeds at which feet that carry move along the ground against the others, ``(n, n_feet)`` [m/s]; else NaN."""
    settings = ProblemSettings(cutoff_hz=cutoff_hz)
    filters = settings.filters(floating=False, lowpass_hz=log.header.lowpass_hz)
    k = trial_kinematics(robot, log.header, trial, settings, filters)
    closed, still = closed_on_grid(robot, trial, k.time), k.v.copy()
    changes = np.zeros(len(closed), dtype=bool)
    changes[1:] = (closed[1:] != closed[:-1]).any(axis=1)
    use = k.valid & ~widen_flags(changes, round(CHANGE_S * k.rate_hz))
    still[:, :3] = 0.0
    out = np.full(closed.shape, np.nan)
    patterns, member = distinct_rows(closed)
    for i, pattern in enumerate(patterns):
        at, feet = np.flatnonzero((member == i) & use), np.flatnonzero(pattern)
        if len(feet) < 2 or not len(at):
            continue
        maps = contact_maps(robot, k.q[at], [robot.feet[f] for f in feet])
        moved = np.einsum("nvk,nv->nk", maps, still[at])
        if moved.shape[1] != 3 * len(feet):
            continue
        moved = moved.reshape(len(at), len(feet), 3)[:, :, :2]
        against = moved[:, ::-1] if len(feet) == 2 else np.median(moved, axis=1, keepdims=True)
        out[at[:, None], feet] = np.linalg.norm(moved - against, axis=2)
    return out
