"""Rules for values that channels take: ends of ranges, coarse steps, constants; torques that mean something else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array, Flags
from excite.doctor.case import Case
from excite.doctor.channel_errors import misreadings
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.torques import ModelParts, parts_in
from excite.doctor.model_comparison import fit_parts, shares_left
from excite.doctor.thresholds import THRESHOLD
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.torque_scale import TORQUE_SCALE, likely_gears, stated_friction
from excite.errors import LogError
from excite.finding import list_names
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.regressor.contact_forces import motor_regressor, motor_torques
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS, JointSamples
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.saturation import flags_at
from excite.rows.settings import ProblemSettings

_UNITS = {"q": " rad", "q_cmd": " rad", "v": " rad/s", "tau": " N·m", "i": " A"}


def find_range_ends(case: Case) -> None:
    """Values that stay at the largest or smallest that the channel has."""
    rows = sum((Counter(trial.cleaning.clipped) for trial in case.log.trials), Counter[str]())
    before = case.log
    case.log = mark_rails(before)
    # Of torques the motion says more, once their columns and units are right (find_torque_ends).
    torque = f"{kind_of_torque(before)}." if case.log is not before else "none"
    kept = {k: n for k, n in rows.items() if not k.startswith(torque) and not _sticks(before, k)}
    if kept:
        said = list_names([f"{name} in {count} rows" for name, count in kept.items()])
        text = f"{said}: clipped at the sensor's range or the drive's limit"
        trials = tuple(trial.name for trial in before.trials if set(kept) & set(trial.cleaning.clipped))
        case.add("clipped", text, {"rows": float(sum(kept.values()))}, tuple(kept), trials=trials)


def _sticks(log: Log, name: str) -> bool:
    """Whether a position stays where dry friction held its joint as it turned back, in each trial elsewhere.

    The end of a sensor's range, or a stop, is at one place in all trials.
    """
    channel, _, joint = name.partition(".")
    if channel != "q" or joint not in log.header.joints or len(log.trials) < 2:
        return False
    place = log.header.joints.index(joint)
    values = [trial.q[:, place] for trial in log.trials]
    top, bottom = max(q.max() for q in values), min(q.min() for q in values)
    near, ends = THRESHOLD.same_end * (top - bottom), Counter[bool]()
    for trial, q in zip(log.trials, values, strict=True):
        if name in trial.cleaning.clipped:
            step = 0.5 * trial.cleaning.quantised.get(name, 0.0)
            above = bool(np.sum(q >= q.max() - step) >= np.sum(q <= q.min() + step))
            ends[above] += (top - q.max() if above else q.min() - bottom) <= near
    return max(ends.values(), default=0) < 2


def find_coarse_steps(case: Case) -> None:
    """Values on a grid that is coarser than the noise."""
    sizes = {name: size for trial in case.log.trials for name, size in trial.cleaning.quantised.items()}
    if not sizes:
        return
    turning = case.joints(case.turning)

    def unit(channel: str) -> str:
        """Units of joints that slide, and of wrenches, differ from part to part and are left out."""
        kind, _, joint = channel.partition(".")
        return _UNITS.get(kind, "") if joint in turning else ""

    said = list_names([f"{name} {size:.3g}{unit(name)}" for name, size in sizes.items()])
    text = f"values come in steps: {said}; a coarse sensor, or few digits in the file"
    trials = tuple(trial.name for trial in case.log.trials if trial.cleaning.quantised)
    case.add("quantised", text, {f"step_{k}": size for k, size in sizes.items()}, tuple(sizes), trials=trials)


def find_constants(case: Case) -> None:
    """Channels that never change over the whole log; a torque that does not is declared to mean nothing."""
    header, trials = case.log.header, case.log.trials
    # A robot that does not move about, of which positions alone were logged.
    unforced = all(t.tau is None and t.current is None and t.q_cmd is None for t in trials)
    if unforced and header.base in ("fixed", "held") and not header.sensors:
        text = "no torque, no current and no command is in the log: nothing shows what moved the joints"
        case.add("no_torques", text, {"channels": 0.0})
        return
    dead: dict[str, str] = {}
    for attribute, prefix in (("tau", "tau"), ("current", "i"), ("q", "q")):
        values = [getattr(trial, attribute) for trial in trials]
        if all(value is not None for value in values):
            still = np.all([np.ptp(value, axis=0) == 0.0 for value in values], axis=0)
            ignored = () if prefix == "q" else header.no_torque
            dead |= {f"{prefix}.{joint}": joint for joint in case.joints(still) if joint not in ignored}
    for sensor in header.sensors:
        readings = [trial.wrenches[sensor.name] for trial in trials if sensor.name in trial.wrenches]
        if readings and all(np.ptp(reading) == 0.0 for reading in readings):
            dead[f"wrench.{sensor.name}"] = ""
    if not dead:
        return
    torques = [joint for name, joint in dead.items() if name.startswith(("tau.", "i."))]
    figures, places = {"channels": float(len(dead))}, tuple(dead)
    if torques and {*header.no_torque, *torques} == set(header.joints):
        text = f"no torque changes at all ({list_names(places)})"
        remedy = "record the torques or currents, or state torque: none"
        case.add("no_torques", text, figures, places, remedy=remedy)
        return
    text = (
        f"{list_names(places)} never change: a dead channel, or a locked joint, whose parameters "
        "are not identifiable"
    )
    more: dict[str, object] = {"severity": "spoils"} if torques or places[0].startswith("wrench") else {}
    if torques:
        remedy = "joints whose torque never changes are treated as no_torque"
        more |= {"repaired": len(torques) == len(dead), "remedy": remedy}
        case.ignore_torques(torques)
    case.add("constant", text, figures, places, **more)


# Torques that stop in some trials, or rows, of a log.


def find_stopped_torques(case: Case) -> None:
    """Torques that stop while the joints go on: a drive switched off, a sensor or a bus that was lost.

    No torque changes over half a second and more while some joint moves; or one joint's never does in a trial in which
    it moves. What is left of such trials is used.
    """
    header = case.log.header
    columns = [header.joints.index(joint) for joint in header.torque_joints]
    lost = {trial.name: stopped_rows(trial, columns) for trial in case.log.trials if columns}
    count = {name: int(rows.sum()) for name, rows in lost.items() if rows.any()}
    if not count:
        return
    gone = {trial.name for trial in case.log.trials if lost[trial.name].sum() > 0.5 * len(trial.time)}
    kept = [k for k, trial in enumerate(case.log.trials) if trial.name not in gone]
    if not any(case.log.trials[k].role == "identification" for k in kept):
        return
    said = list_names([f"{rows} rows of {name}" for name, rows in count.items()])
    text = f"torques stop while joints move, in {said}: the drives were off, or their channel was lost"
    case.add("stopped_torques", text, {"rows": float(sum(count.values()))}, trials=tuple(count))
    trials = tuple(case.log.trials[k].rows(~lost[case.log.trials[k].name]) for k in kept)
    case.log = replace(case.log, trials=trials)
    case.change_header(trials=tuple(header.trials[k] for k in kept))


def stopped_rows(trial: Trial, columns: Sequence[int]) -> Flags:
    """Rows of a trial in which torques say nothing, ``(n,)``.

    Args:
        trial: the trial.
        columns: joints whose torques were measured.
    """
    values, lost = _trial_torques(trial), np.zeros(len(trial.time), dtype=np.bool_)
    if values is None:
        return lost
    changes = np.flatnonzero(np.diff(values[:, columns], axis=0).any(axis=1)) + 1
    first, end = np.append(0, changes), np.append(changes, len(lost))
    seconds = trial.time[end - 1] - trial.time[first]
    for k in np.flatnonzero(seconds > THRESHOLD.held_torque_s):
        held = slice(first[k], end[k])
        lost[held] = np.ptp(trial.q[held], axis=0).max() > THRESHOLD.still * seconds[k]
    moves = np.ptp(trial.q[:, columns], axis=0) > THRESHOLD.still * (trial.time[-1] - trial.time[0])
    return lost | bool((moves & (np.ptp(values[:, columns], axis=0) == 0.0)).any())


# Torques that are too weak, or those before the gear.


def find_unsigned_torques(case: Case) -> None:
    """Torques of one sign that agree with the model far better with the sign that it gives each sample."""
    samples, reading = case.samples, Reading.as_stated(case.log)
    if samples is None:
        return
    torque, (model, drive, columns) = samples.measured_torque(reading), samples.predicted(reading)
    columns_of = [case.log.header.joints.index(joint) for joint in samples.channels]
    values = [
        found[:, columns_of] for trial in case.log.trials if (found := _trial_torques(trial)) is not None
    ]
    one_sign = np.all([(one >= 0.0).all(axis=0) for one in values], axis=0)
    if not one_sign.any():
        return
    signed, x = np.sign(model) * torque, np.stack([*drive, model, np.ones_like(model)])
    # Friction turns some signs: fit and signs in turn.
    for _ in range(8):
        fit = [x[:, :, j].T @ np.linalg.lstsq(x[:, :, j].T, signed[:, j])[0] for j in range(torque.shape[1])]
        signed = np.sign(np.column_stack(fit)) * torque
    before = np.minimum(*(shares_left(columns.sums_with(sign * torque)) for sign in (1.0, -1.0)))
    after = shares_left(columns.sums_with(signed))
    lost = one_sign & (
        np.log(before) - np.log(np.maximum(after, THRESHOLD.least_share)) > 2.0 * THRESHOLD.sign_tells
    )
    lost &= after < THRESHOLD.in_place
    if lost.any():
        names = tuple(np.array(samples.channels)[lost].tolist())
        text = f"torques of {list_names(names)} are never negative where the model's are: they have lost their sign"
        more = {"severity": "fatal", "repaired": False} if lost.all() else {}
        case.add("unsigned_torques", text, {"joints": float(len(names))}, names, **more)
        case.ignore_torques(names)


def find_weak_torques(case: Case) -> None:
    """Torques far below what the nominal masses need, of some joints or of most."""
    samples, reading = case.samples, Reading.as_stated(case.log)
    if samples is None:
        return
    parts = None if case.log.header.torque == "current" else of_unknown_unit(samples, reading)
    if parts is not None:
        _report_unknown_unit(case, samples, parts, reading)
        return
    gains = samples.gains(reading)[0]
    # No likely body, friction or rotor explains them, and what a dead channel reads is small: what a spring or a cable
    # takes hides the bodies' torque and is large. A torque that is cut off is weaker than it was.
    unexplained = samples.judged(reading).left > 0.5 * np.log(THRESHOLD.unexplained)
    read, needed = samples.measured_torque(reading).std(axis=0), samples.predicted(reading)[0].std(axis=0)
    whole, limit = never_at_end(case.log, samples), THRESHOLD.weak_torque
    weak = unexplained & (np.abs(gains) < limit) & (read < limit * needed) & whole
    if weak.any() and 2 * weak.sum() <= len(weak):
        names = tuple(np.array(samples.channels)[weak])
        text = (
            f"torques of {list_names(names)} are at most {max(float(gains[weak].max()), 0.0):.2g} times what the "
            "nominal masses need, unlike the others: a dead channel, or another unit"
        )
        case.add("weak_torque", text, {"joints": float(len(names))}, names)
        case.ignore_torques(names)


def find_motor_side(case: Case) -> None:
    """Torques called link-side that hold the rotors' inertia or the gears' friction.

    Rotors show at the outer joints, which carry little else.
    """
    samples = case.samples
    if samples is None or case.log.header.torque != "link_side" or case.is_strange:
        return
    outer, rubbing = _rotors(samples, Reading.as_stated(case.log))
    joints = samples.channels
    # Friction alone is seen behind the gear too, in bearings and seals; inertia that is negative is no rotor's.
    if outer >= (0.0 if 2 * rubbing > len(joints) else THRESHOLD.rotor_share):
        text = (
            f"torques are called link_side, yet they hold rotor inertia ({outer:.2g} times the links' own at the outer "
            f"joints) and friction ({rubbing} joints): they are probably motor-side"
        )
        case.add("torque_side", text, {"rotor_share": outer, "joints": float(rubbing)}, joints)


def _rotors(samples: TorqueSamples, reading: Reading) -> tuple[float, int]:
    """Rotor inertia at the outer joints, as share of the links', and the number of joints that rub."""
    sums, own = samples.product_sums(reading), _own_inertia(samples)
    fit, moves = fit_parts(sums), own > THRESHOLD.weightless_kgm2
    rotors = fit.drive[:, 2] / np.where(moves, own, 1.0)
    # A joint tells of a rotor where all of its links' inertia would be larger than what nothing explains.
    told = moves & (own**2 * sums[:, 2, 2] > fit.left)
    rubbing = int((moves & (fit.friction > THRESHOLD.friction_share * sums[:, 4, 4])).sum())
    tell = [rotors[some] for some in (moves, told) if some.any()]
    return min((float(np.median(some[-max(1, len(some) // 2) :])) for some in tell), default=0.0), rubbing


def find_missing_friction(case: Case) -> None:
    """Torques that hold next to nothing of the friction that the other joints have, by what their drives can give.

    A driver has subtracted its model of it, or a sensor sits behind one joint's gear. Friction is that beside likely
    bodies: what nominal masses are off by looks like some.
    """
    samples, reading = case.samples, Reading.as_stated(case.log)
    if samples is None or case.log.header.torque != "motor_side" or case.is_strange:
        return
    judged, drive = samples.judged(reading), samples.predicted(reading).drive
    viscous, dry = judged.drives[:, 1], judged.drives[:, 2]
    fast = np.quantile(np.abs(drive[0]), 0.9, axis=0)
    friction = dry + viscous * fast
    left = samples.measured_torque(reading).std(axis=0) * np.exp(judged.left)
    whole = replace(reading, gravity=case.robot.model.gravity.linear)
    needed = samples.predicted(whole).torque.std(axis=0)
    joints = np.array(samples.channels)
    limits = np.asarray(case.robot.limits.torque, dtype=float)[[case.robot.joint_index(j) for j in joints]]
    # What is cut off of a torque is friction, too.
    moves = (fast > THRESHOLD.still) & never_at_end(case.log, samples)
    clear = moves & (friction > left)
    usual = float(np.quantile((friction / limits)[clear], 0.5, method="higher")) if clear.any() else 0.0
    # What the others have would stand out of what nothing explains there.
    lacks = moves & (friction < THRESHOLD.next_to_nothing * usual * limits) & (left < usual * limits)
    usual_sizes = THRESHOLD.next_to_nothing * needed, THRESHOLD.gear_friction * limits
    nowhere = moves & (friction < np.minimum(*usual_sizes)) & (left < np.maximum(*usual_sizes))
    # A model may state friction, and the whole of it would stand out of what nothing explains.
    at_speed = dict(zip(samples.channels, fast.tolist(), strict=True))
    stated = np.array([stated_friction(case.robot, at_speed).get(joint, 0.0) for joint in samples.channels])
    beneath = moves & (friction < THRESHOLD.weak_torque * stated) & (left < stated)
    more: dict[str, object] = {}
    # Of a robot whose log says nothing of friction none is missed.
    has_friction = {*DRIVE_TERMS["coulomb"].effects} & {*case.log.header.modelled}
    most = [one for one in (nowhere, beneath) if has_friction and 2 * one.sum() > moves.sum()]
    if most:
        lacks, more = most[0], {"severity": "note"}
    elif not clear.sum() >= lacks.sum() > 0:
        return
    each = {f"friction.{joint}": float(size) for joint, size in zip(joints, friction, strict=True)}
    said = list_names([f"{joint} {size:.2g} N·m" for joint, size in zip(joints, friction, strict=True)], 8)
    text = (
        f"torques of {list_names(joints[lacks])} hold next to no friction ({said}): a driver has subtracted it, or "
        "they were measured behind the gear"
    )
    if most and most[0] is beneath:
        told = list_names([f"{joint} {size:.2g} N·m" for joint, size in zip(joints, stated, strict=True)], 8)
        text += f", or the friction that the model states there is a placeholder ({told})"
    case.add("no_friction", text, each, tuple(joints[lacks]), **more)


def _own_inertia(samples: TorqueSamples) -> Array:
    """Mean inertia that each measured joint has by the nominal model, ``(n_torques,)``: torque per acceleration."""
    q = samples.q[:: max(1, len(samples.q) // 20)]
    rest, model = np.zeros((len(q), samples.v.shape[1])), samples.robot.model
    places = samples.places[samples.measured]
    still = inverse_dynamics(model, q, rest, rest)
    pushed = [inverse_dynamics(model, q, rest, rest + row) for row in np.eye(rest.shape[1])[places]]
    return np.array([(one - still)[:, k].mean() for one, k in zip(pushed, places, strict=True)])


def of_unknown_unit(samples: TorqueSamples, reading: Reading) -> ModelParts | None:
    """What torques hold of the nominal bodies where that is next to nothing, and no factor tells their unit.

    Friction hides the factor, and whatever else such torques seem to betray is friction's, too. Joints that need most
    of the robot's torque have to tell so, more than one of them: of a joint alone it may be a motion that needs no
    torque, as a pendulum swings.
    """
    parts = parts_in(samples, reading)
    needed = samples.predicted(reading).torque.std(axis=0)
    few = parts.told.sum() < 2 or needed[parts.told].sum() <= 0.5 * needed.sum()
    if few or parts.size(needed) > THRESHOLD.next_to_nothing:
        return None
    # So do those that tell a factor.
    gains = samples.gains(reading)
    close = (gains.share > THRESHOLD.telling_share) & (gains.agreement > THRESHOLD.closely)
    told = needed[close].sum() > 0.5 * needed.sum()
    return None if told and misreadings(samples, reading, (TORQUE_SCALE,))[1] else parts


def _report_unknown_unit(case: Case, samples: TorqueSamples, parts: ModelParts, reading: Reading) -> None:
    text = (
        f"torques contain almost nothing of what the nominal masses need ({parts.said()}): they are torques before "
        f"gears{likely_gears(samples, reading)}, currents, another unit, or external torques, from which a driver has "
        "subtracted its model"
    )
    factors = ", ".join(f"tau.{joint}: RATIO" for joint in samples.channels[:2])
    remedy = (
        f"state the joints' gear ratios or torque constants (scale: {{{factors}, …}} in map.yaml), or log "
        "torques as measured; results are in the log's unit and give no weights"
    )
    case.add("torque_scale", text, parts.figures(), samples.channels, remedy=remedy)
    case.doubts.add(Doubt.SIZE)


# Torques at an end of their range: left out where they say less than there was, kept where the drive gave no more.


def set_clipped_aside(case: Case) -> None:
    """Set torques aside that are at an end of their range in most rows: by what is cut off mistakes look likely."""
    joints, samples = case.log.header.torque_joints, sum(len(trial.time) for trial in case.log.trials)
    most = [j for j in joints if samples - _marked_rows(case.log, [j]) < THRESHOLD.rows_within * samples]
    if 0 < len(most) < len(joints):
        case.set_aside = tuple(most)
        case.ignore_torques(most)


def find_torque_ends(case: Case) -> None:
    """Torques, or currents, at the largest or smallest value that they have."""
    log, kind = case.log, kind_of_torque(case.log)
    rows = {joint: count for joint in log.header.torque_joints if (count := _marked_rows(log, [joint]))}
    told = not log.header.free_base and case.robot.mechanism is None and not log.header.coupling
    beyond = {joint: torque_overshoot(case.robot, log, joint) if told else None for joint in rows}
    held = [joint for joint, times in beyond.items() if times is not None and times <= THRESHOLD.rail_agrees]
    samples = sum(len(trial.time) for trial in log.trials)
    silent = [j for j in rows if j not in held and samples - rows[j] < THRESHOLD.least_within * samples]
    lost = [joint for joint in rows if joint not in (*held, *silent)]
    clipped = "clipped at the sensor's range: by the motion the torque was larger; "
    for finding, joints, share, what in (
        ("drive_limit", held, "", "at the drive's limit: the motion agrees with this torque"),
        ("clipped", lost, f" of {samples}", f"{clipped}these rows of their joints are left out"),
        ("clipped", silent, f" of {samples}", f"{clipped}these joints are treated as no_torque"),
    ):
        if joints:
            said = list_names([f"{kind}.{joint} in {rows[joint]}{share} rows" for joint in joints])
            trials = tuple(t.name for t in log.trials if _marked_rows(replace(log, trials=(t,)), joints))
            places = tuple(f"{kind}.{joint}" for joint in joints)
            figures = {"rows": float(sum(rows[joint] for joint in joints))}
            case.add(finding, f"{said}: {what}", figures, places, trials=trials)
    if held:
        kept = ~np.isin(log.header.joints, held)
        case.change_trials(lambda t: t if t.beyond is None else _mark_rows(t, t.beyond & kept))
    if silent:
        case.ignore_torques(silent)


def _mark_rows(trial: Trial, beyond: Flags) -> Trial:
    return replace(trial, beyond=beyond if beyond.any() else None)


def _marked_rows(log: Log, joints: Sequence[str]) -> int:
    """Rows in which a torque of some joints is at an end of its range, counted for each."""
    columns = [log.header.joints.index(joint) for joint in joints]
    return sum(int(trial.beyond[:, columns].sum()) for trial in log.trials if trial.beyond is not None)


def never_at_end(log: Log, samples: TorqueSamples) -> Flags:
    """Torques that are never at an end of their range, ``(n_torques,)``."""
    return np.array([not _marked_rows(log, [name]) for name in samples.channels])


def kind_of_torque(log: Log) -> str:
    """First part of the names of the log's torques or currents."""
    return "i" if log.header.torque == "current" else "tau"


def _trial_torques(trial: Trial) -> Array | None:
    return trial.tau if trial.tau is not None else trial.current


def mark_rails(log: Log) -> Log:
    """The log with its trials' samples marked in which a torque or current is at an end of its range.

    A trial that reaches the end at which another one is clipped is at it too.
    """
    kind, rails = kind_of_torque(log), set[tuple[int, float]]()
    for trial in log.trials:
        values = _trial_torques(trial)
        for j, joint in enumerate(log.header.joints):
            count = trial.cleaning.clipped.get(f"{kind}.{joint}", 0)
            if values is not None and count:
                # The channel was found to be clipped at one end or both; at an end that it is not it stays a moment.
                ends = (float(values[:, j].min()), float(values[:, j].max()))
                rails |= {(j, end) for end in ends if 4 * (values[:, j] == end).sum() >= count}

    def marked(trial: Trial) -> Trial:
        values = _trial_torques(trial)
        if values is None:
            return trial
        flags = np.zeros(values.shape, dtype=np.bool_)
        for j, rail in rails:
            flags[:, j] |= values[:, j] == rail
        return _mark_rows(trial, flags)

    return replace(log, trials=tuple(map(marked, log.trials))) if rails else log


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
    parts = []
    logged = ((trial, values) for trial in log.trials if (values := _trial_torques(trial)) is not None)
    for trial, values in logged:
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
        except LogError:
            continue
        here = np.flatnonzero(k.in_motion)
        here = here[:: max(1, int(len(log.trials) * len(here) / THRESHOLD.rail_samples))]
        q, v, a = k.q[here], k.v[here], k.a[here]
        samples = JointSamples(robot, q, v, a, [place], settings.coulomb_width, None)
        terms = ("viscous", "coulomb", "offset", "armature")
        drives = np.concatenate([DRIVE_TERMS[term].columns(samples) for term in terms], axis=2)[:, 0]
        torque = forces_on_grid(trial.time, values[:, [column]], k.time)[here, 0]
        flags = np.zeros_like(values, dtype=np.bool_) if trial.beyond is None else trial.beyond
        parts.append(
            (
                np.hstack([motor_regressor(robot, q, v, a)[:, place], drives]),
                torque - motor_torques(robot, q, v, a)[:, place],
                flags_at(trial.time, flags[:, [column]], k.time)[here, 0],
                torque,
            )
        )
    if not parts:
        return None
    x, y, at, measured = (np.concatenate(part) for part in zip(*parts, strict=True))
    if (~at).sum() < THRESHOLD.fewest_at_rail or not at.any():
        return None
    x = x / np.maximum(np.linalg.norm(x[~at], axis=0), 1e-9)
    gram = x[~at].T @ x[~at] + THRESHOLD.held_to_nominal * np.eye(x.shape[1])
    left = y - x @ np.linalg.solve(gram, x[~at].T @ y[~at])
    outwards = np.sign(measured[at] - np.median(measured[~at]))
    deviation = float(np.sqrt((left[~at] ** 2).mean()))
    return -float((outwards * left[at]).mean()) / max(deviation, 1e-300)
