"""What torques and currents are worth, and what they tell of units and rate, by the nominal model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from excite.arrays import Array, widen_flags
from excite.conversion.columns.clock import FASTEST_HZ, SLOWEST_HZ, Table
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Question, UnclearError
from excite.conversion.recording import Machine, Recording
from excite.conversion.result import Conversion
from excite.conversion.trials import Cut
from excite.display import span
from excite.doctor.channel_errors import explained
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import STRONG_ODDS, Judgement
from excite.doctor.mistakes.torques import best_load
from excite.doctor.thresholds import THRESHOLD
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.doctor.torque_scale import Scale, find_scale
from excite.errors import InputError, LogError
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader
from excite.logs.log import Trial as Recorded
from excite.logs.robot import nominal_robot
from excite.logs.units import TO_SI
from excite.regressor.contact_forces import contact_maps, motor_torques
from excite.robot.joint_values import per_joint
from excite.robot.quantities import GRAVITY
from excite.robot.robot import Robot
from excite.rows.kinematics import forces_on_grid, in_velocities, trial_kinematics
from excite.rows.settings import ProblemSettings
from excite.temporary_folder import TemporaryFolder

# Two minutes at 1 kHz tell a scale, and are held beside the recording.
_MOST_ROWS = 120_000
# Share of a current's power that gravity and inertia have to explain before their size says anything of its scale.
# Less of it does where what friction and back-EMF leave is closely the nominal torque.
_TELLING, _SOME = 0.5, 0.15
# A foot carries where torques press it on the ground by more than this share of the robot's weight; where they do not
# for less than twice this time [s], it has not left the ground. Of a simulated Go2 that trots, torques so filtered [Hz]
# miss 1 % of the samples in which a foot carries, and 2 % are taken for carrying.
_CARRIES, _FLICKER_S, _SHARP_HZ = 0.1, 0.01, 60.0
# Another order of the legs has to leave less of the base's wrench, by this sum of logarithms over its six axes.
_OTHER_LEGS = 1.0
_MOVED, _PUSHED = ("q", "v", "a", "q_cmd"), ("tau", "tau_cmd")
Trial = Callable[[Map], Conversion]


def joint_sided(table: Table, mapping: Map, joints: Sequence[str], source: object) -> Table:
    """The table with joint positions ``R⁻¹ θ`` and joint torques ``Rᵀ τ`` of motors ``θ = R q``.

    Raises:
        LogError: the matrix of the map is not square, singular, or not of the joints' number.
    """
    if not mapping.motors:
        return table
    if {len(row) for row in mapping.motors} | {len(mapping.motors)} != {len(joints)}:
        raise LogError(
            f"motors: is no matrix of {len(joints)} rows and columns",
            source=source,
            remedy="one row a motor, in map.yaml",
        )
    gears = np.array(mapping.motors, dtype=float)
    # Smaller pivots are no gear: the largest robots' ratios have some thousand.
    if abs(np.linalg.det(gears / np.abs(gears).max())) < 1e-9 ** len(joints):
        raise LogError("motors: cannot be inverted", source=source, remedy="correct the ratios in map.yaml")
    columns, inverse = dict(table.columns), np.linalg.inv(gears)
    for channel in (*_MOVED, *_PUSHED):
        names = [f"{channel}.{joint}" for joint in joints]
        if set(names) <= set(columns):
            matrix = inverse.T if channel in _MOVED else gears
            values = np.column_stack([columns[name] for name in names]) @ matrix
            columns |= dict(zip(names, values.T, strict=True))
    return replace(table, columns=columns)


def leg_forces(
    trial: Recorded, tau: Array, header: LogHeader, robot: Robot
) -> tuple[dict[str, Array], Array]:
    """What the torques of legs say of the ground, beside the nominal robot's own motion.

    Args:
        trial: of a robot on its feet, with readings of the IMU or the base's pose.
        tau: its torques, ``(n, n_joints)`` [N·m].
        header: header of the log.
        robot: the nominal robot.

    Returns:
        Force on each foot by its name at the trial's times, ``(n,)`` [N], and the deviation of what these forces leave
        of the base's wrench, ``(6,)`` [N, N·m].

    Raises:
        LogError: the trial is too short for the filter.
    """
    cutoff = min(_SHARP_HZ, 0.2 * header.rate_hz)
    settings = ProblemSettings(cutoff_hz=cutoff, kinematics_cutoff_hz=cutoff)
    filters = settings.filters(floating=False, lowpass_hz=header.lowpass_hz)
    k, nb, drives = (
        trial_kinematics(robot, header, trial, settings, filters),
        robot.n_base_v,
        robot.description.drives,
    )
    torque = in_velocities(robot, header.joints, forces_on_grid(trial.time, tau, k.time))
    left, forces = motor_torques(robot, k.q, k.v, k.a) - torque, {}
    v, a = k.v[:, nb:], k.a[:, nb:]
    for sizes, by in ((drives.armature, a), (drives.viscous, v), (drives.coulomb, np.sign(v))):
        left[:, nb:] += per_joint(sizes, robot.joint_names, np.zeros(robot.n_joints)) * by
    wrench = left[:, :nb].copy()
    for foot in robot.feet:
        maps = contact_maps(robot, k.q, [foot])
        # A leg that is stretched tells no force along it.
        force = np.linalg.pinv(maps[:, nb:], rcond=0.05) @ left[:, nb:, None]
        wrench -= (maps[:, :nb] @ force)[..., 0]
        forces[foot.name] = np.interp(trial.time, k.time, np.linalg.norm(force[:, :3, 0], axis=1))
    return forces, np.sqrt((wrench[k.valid] ** 2).mean(axis=0))


def with_contacts(trial: Recorded, tau: Array, header: LogHeader, robot: Robot) -> Recorded:
    """The trial with contact flags by the forces that its torques tell; arguments as of :func:`leg_forces`.

    Raises:
        LogError: it is too short, or hardly anything carries: the robot hangs, or these are no torques of its legs.
    """
    least, few, flags = _CARRIES * robot.mass * GRAVITY, round(_FLICKER_S * header.rate_hz), {}
    for name, force in leg_forces(trial, tau, header, robot)[0].items():
        flags[name] = ~widen_flags(~widen_flags(force > least, few), few)
    if np.mean(np.any(list(flags.values()), axis=0)) < 0.5:
        raise LogError(
            f"no foot of {robot.name} carries in most of it, by the torques of its legs",
            source=trial.name,
            field="log.base",
            remedy="write log: {base: held} into a map.yaml where a stand or hands hold it, or log: {base: suspended, "
            f"base_link: {robot.segments[0].link}}} where it hangs, and run again with --map",
        )
    return replace(trial, contacts=flags)


def ask_for_legs(log: Log, robot: Robot, found: Guesses, recording: Recording) -> None:
    """Raise UnclearError where columns that are only counted carry the robot by another order of its legs."""
    joints, (trial, *_) = list(log.header.joints), log.role("identification")
    n, feet = len(joints), len(robot.feet)
    counted = any(what == "order of legs" for what, _, _ in found.rows())
    if not counted or n % feet or trial.tau is None or log.header.no_torque or log.header.base != "floating":
        return
    # Sides exchanged, as Unitree's SDK and models have them; all hips first; both.
    table = np.arange(n).reshape(feet, -1)
    sides = table[np.arange(feet) ^ 1] if feet % 2 == 0 else table
    orders, rests = [one.ravel() for one in (table, sides, table.T, sides.T)], []
    for order in orders:
        # Column c is of joint order[c].
        back = np.argsort(order)
        moved = replace(trial, q=trial.q[:, back], v=None, q_cmd=None, tau=trial.tau[:, back])
        rests.append(np.log(leg_forces(moved, trial.tau[:, back], log.header, robot)[1]).sum())
    best = int(np.argmin(rests))
    if rests[best] < rests[0] - _OTHER_LEGS:
        names = [joints[k] for k in orders[best]]
        found.ask("legs otherwise", first=names[0], second=names[1], joints=", ".join(names))
        raise UnclearError(found.questions, recording.source)


def ask_for_scale(
    cuts: Sequence[Cut],
    header: LogHeader,
    machine: Machine,
    found: Guesses,
    stated: Map,
    recording: Recording,
) -> None:
    """Raise UnclearError where torques of no stated unit look like shares of limits, or currents, by the nominal model.

    Nothing is asked where a name, the format or the map states the torques' unit or scale. The first rows of the
    longest motion that is for identification are looked at.

    Args:
        header: header of the log that is to be written.
        found: how the columns were understood.
        recording: the first of the recordings.
    """
    torques = found.of("tau")
    known = any(key.partition(".")[0] == "tau" for key in (*stated.units, *stated.scale))
    pairs = [pair for pair in zip(cuts, header.trials, strict=True) if pair[1].role == "identification"]
    if not torques or known or "torque" in stated.log or any(item.unit for item in torques):
        return
    if not pairs or header.base not in ("fixed", "held"):
        return
    cut, entry = max(pairs, key=lambda pair: len(pair[0].columns["time"]))
    entry = entry.model_copy(update={"repeats": None})
    alone = header.model_copy(update={"trials": (entry,)})
    folder = TemporaryFolder()
    try:
        columns = {name: values[:_MOST_ROWS] for name, values in cut.columns.items()}
        trial = read_columns(columns, entry, alone, Path(entry.file))
        save_log(Log(header=alone, trials=(trial,), robot_text=machine.text), folder.path / "log")
        scale = _unknown_scale(load_log(folder.path / "log"))
    except (InputError, ValidationError):
        return
    if scale is not None:
        found.ask(
            "no newton metres",
            columns=f"{torques[0].source} …",
            joint=torques[0].joint,
            cause=scale.cause,
            scale=scale.line(header.torque_joints),
        )
        raise UnclearError(found.questions, recording.source)


def _unknown_scale(log: Log) -> Scale | None:
    """What torques look like that are no N·m, of either sign each; None where masses or a load may make them so."""
    samples = _samples(nominal_robot(log), log)
    if samples is None or log.header.torque == "current":
        return None
    stated = Reading.as_stated(log)
    reading = replace(stated, torque_factor=np.where(samples.gains(stated)[0] < 0.0, -1.0, 1.0))
    scale = find_scale(samples, reading)
    return scale if scale is not None and scale.far and best_load(samples, reading) is None else None


class Gain(NamedTuple):
    """How large a joint's torques, or currents or voltages, are beside those of the nominal model.

    Attributes:
        gain: logged torque, or other unit, per N·m of the nominal model; negative where the sign is turned.
        share: share of the logged power that gravity and inertia explain beside the joint's friction.
    """

    gain: float
    share: float


def torque_gains(robot: Robot, log: Log) -> dict[str, Gain]:
    """Gains of the joints whose torques follow gravity and inertia closely; friction and back-EMF are beside them.

    A voltage makes the torque ``kt/R V − kt²/R ω``: the second part looks like viscous friction, kt/R is the scale.

    Args:
        log: the log; of currents without constants, each ampere is taken for a newton metre.
    """
    if log.header.torque == "current" and not log.header.torque_constants:
        constants = dict.fromkeys(log.header.torque_joints, 1.0)
        log = replace(log, header=log.header.model_copy(update={"torque_constants": constants}))
    samples, reading = _samples(robot, log), Reading.as_stated(log)
    if samples is None:
        return {}
    rows = zip(log.header.torque_joints, *samples.gains(reading), strict=True)
    return {
        joint: Gain(float(gain), float(share))
        for joint, gain, share, agreement, _ in rows
        if gain and (share > _TELLING or (share > _SOME and agreement > THRESHOLD.closely))
    }


def _samples(robot: Robot, log: Log) -> TorqueSamples | None:
    """Samples of the torques of an arm; None where there are none."""
    if log.header.torque in ("none", None) or log.header.base not in ("fixed", "held"):
        return None
    try:
        return torque_samples(robot, log)
    except InputError:
        return None


def propose_constants(robot: Robot, log: Log) -> list[str]:
    """Torque per ampere of each joint whose current the nominal model explains, in a sentence; none of other logs.

    Nothing of it is applied, as the nominal model may be what is wrong.
    """
    placed = log.header.base in ("fixed", "held")
    if log.header.torque != "current" or log.header.torque_constants or not placed:
        return []
    gains = torque_gains(robot, log)
    if not gains:
        return ["no current follows gravity and inertia closely enough to tell torques per ampere"]
    said = ", ".join(f"{joint}: {1.0 / one.gain:.3g}" for joint, one in gains.items())
    return [
        f"by the nominal masses, N·m per A are {{{said}}}; "
        "write them under log: {torque_constants: …} in map.yaml if data sheets agree"
    ]


@dataclass(frozen=True)
class Settled:
    """An answer that torques gave.

    Attributes:
        mapping: what a person said, and the answer.
        because: what speaks for it.
    """

    mapping: Map
    because: str


def settle_by_torques(questions: Sequence[Question], tried: Trial, stated: Map) -> Settled | None:
    """The answer to the one question that there is, of positions' units, where torques give one.

    Likely bodies explain torques by the postures that a robot took: by those of degrees 57 times closer together than
    by those of radians. The best unit has to explain them better than the second by what any misreading has to bring.

    Args:
        questions: what a recording leaves open.
        tried: what converts the recording by another map, whatever its torques' scale.
        stated: what a person said.
    """
    (question,) = questions if len(questions) == 1 else (None,)
    if question is None or len(question.units) < 2:
        return None
    maps = [stated.model_copy(update={"units": {**stated.units, **units}}) for units in question.units]
    try:
        log = tried(maps[0]).log
        left = _judge_units(log, question.units)
    except InputError:
        return None
    if left is None:
        return None
    best, second = np.argsort([left[0].odds(one) for one in left])[:-3:-1]
    gain = left[second].posterior(left[best])
    none = np.zeros(len(left[0].left), dtype=bool)
    if gain < STRONG_ODDS or not explained(left[second].left, left[best].left, none):
        return None
    said = " and ".join(dict.fromkeys(question.units[int(best)].values()))
    because = f"{said}: so likely bodies explain the torques (by {gain:.1f} nat better than in another unit)"
    return Settled(maps[int(best)], because)


def _judge_units(log: Log, units: Sequence[Mapping[str, str]]) -> list[Judgement] | None:
    """What likely bodies leave of the torques with positions in each of the units, of which the first is the log's."""
    samples = None if log.header.free_base else _samples(nominal_robot(log), log)
    if samples is None:
        return None
    of_joint = [[one.get(f"q.{j}", one.get("q", "rad")) for j in log.header.joints] for one in units]
    sizes = np.array([[TO_SI[name] for name in names] for names in of_joint])
    reading = Reading.as_stated(log)
    readings = [replace(reading, unit=np.where(samples.sliding, 1.0, size / sizes[0])) for size in sizes]
    first = samples.judged(readings[0])
    return [first, *(samples.judged(read, first.counts) for read in readings[1:])]


def weigh_question(questions: Sequence[Question], tried: Trial, stated: Map) -> list[Question]:
    """The questions; one alone with what the nominal model makes of it: a torque per volt or duty cycle, or a rate."""
    (question,) = questions if len(questions) == 1 else (None,)
    if question is not None and question.key == "rate":
        return [_with_rate(question, tried, stated)]
    if question is None or not question.torques:
        return list(questions)
    try:
        found = tried(stated.model_copy(update={"columns": {**stated.columns, **question.torques}}))
        scales = torque_gains(nominal_robot(found.log), found.log)
    except InputError:
        scales = {}
    if not scales:
        return list(questions)
    small = any(factor == 1e-3 for target, (_, factor) in found.columns.items() if target in question.torques)
    units, unit = ("units: {tau: N·mm} and ", "N·mm") if small else ("", "N·m")
    worth = {f"tau.{joint}": f"{1.0 / scale.gain:.3g}" for joint, scale in scales.items()}
    factors = ", ".join(f"{target}: {worth.get(target, 'FACTOR')}" for target in question.torques)
    columns = ", ".join(f'{target}: "{column}"' for target, column in question.torques.items())
    line = (
        f"columns: {{{columns}}} and {units}scale: {{{factors}}}   # {unit} per unit by the nominal masses, whose "
        f"weight and inertia are {100.0 * min(s.share for s in scales.values()):.0f} % of it; or log: {{torque: none}}"
    )
    return [replace(question, line=line)]


def _with_rate(question: Question, tried: Trial, stated: Map) -> Question:
    """The question for the rate of the rows, with the one at which inertial forces explain the torques.

    Weight does not depend on the rate, inertial forces do, with its square. Torques of either sign are tried: a turned
    one looks like no rate at all. The rate is proposed where it has an end on both sides within what any misreading has
    to bring, and where the model then explains half of the torques' power.
    """
    if "NUMBER" not in question.line:
        return question
    rates = np.geomspace(SLOWEST_HZ, FASTEST_HZ, 200)
    at, which, near = len(rates) // 2, 0, np.arange(0)
    for _ in range(2):
        try:
            log = tried(stated.model_copy(update={"log": {**stated.log, "rate_hz": float(rates[at])}})).log
        except InputError:
            return question
        samples = _samples(nominal_robot(log), log)
        if samples is None:
            return question
        left = []
        for sign in (1.0, -1.0):
            reading = Reading.as_stated(log)
            reading = replace(reading, torque_factor=sign * reading.torque_factor)
            by_clock, counts = samples.by_clock(reading), samples.judged(reading).counts
            left.append(by_clock(rates[at] / rates) @ counts / counts.sum())
        # The first trial's rate is a guess, by which its samples were taken.
        which, at = (int(k) for k in np.unravel_index(int(np.argmin(left)), np.shape(left)))
        near = np.flatnonzero(left[which] < left[which][at] + STRONG_ODDS / counts.sum())
        if near[0] == 0 or near[-1] == len(rates) - 1 or np.exp(2.0 * left[which][at]) > 0.5:
            return question
    rate, low, high = (float(f"{one:.2g}") for one in (rates[at], rates[near[0]], rates[near[-1]]))
    signs = ", with the sign of the torques turned" if which else ""
    around = span(f"{low:g}", f"{high:g}", " to ")
    why = f", as the nominal inertias say ({around} explain the torques about as well{signs})"
    return question.with_rate(rate, why)
