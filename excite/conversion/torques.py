"""What the torques and currents of a recording are worth, by the nominal model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from excite.arrays import Array
from excite.conversion.columns.clock import FASTEST_HZ, SLOWEST_HZ, Table
from excite.conversion.columns.families import Family
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import RATE_LINE, Guesses, Question, UnclearError
from excite.conversion.recording import Machine, Recording
from excite.conversion.result import Conversion
from excite.conversion.trials import Cut
from excite.doctor.channel_errors import explained
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import STRONG_ODDS, Judgement
from excite.doctor.limit_shares import AS_STATED, Share, share_of_limits
from excite.doctor.mistakes.torques import Load, carried_load
from excite.doctor.torque_samples import torque_samples
from excite.errors import InputError, LogError, RobotError
from excite.formats.documents import parse_xml
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader
from excite.logs.robot import nominal_robot
from excite.logs.units import TO_SI
from excite.robot.robot import Robot
from excite.temporary_folder import TemporaryFolder

# Torque constants as a controller has them: the torques and the currents that it asks for, side by side.

# What is asked of a motor is a joint's torque and its friction. In six runs of a UR10e, whose constants nobody has
# published, joints that these explain so well have slopes that agree from run to run within 3 % (12.0, 9.8 and
# 10.6 N·m/A); those of the others, which hardly carry anything, are anything from 5 to 12.
_EXPLAINED = 0.98
# Velocity over which friction changes sign, as share of the joint's fastest.
_WIDTH = 0.02


def note_controllers_constants(
    found: Guesses, chosen: Mapping[str, Family], groups: Sequence[Family], recording: Recording
) -> None:
    """Say what N·m per A the controller itself reckons with, where a recording of currents has its targets of both.

    ``target_moment`` and ``target_current`` of Universal Robots are such: torque = constant × current − friction.
    """
    torque, speed = chosen.get("tau_cmd"), chosen.get("v")
    asked = next((one for one in groups if one.quantity == "i" and not one.target), None)
    if asked is None or torque is None or speed is None or "i" not in chosen or "tau" in chosen:
        return
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    constants = {}
    for joint, name in asked.placed.columns.items():
        if joint in torque.placed.columns and joint in speed.placed.columns:
            parts = (columns[family.placed.columns[joint]] for family in (torque, speed))
            constant = _constant(columns[name], *parts)
            if constant is not None:
                constants[joint] = constant
    if constants:
        said = ", ".join(f"{joint}: {constant:.3g}" for joint, constant in constants.items())
        found.facts.append(
            (
                "N·m per A",
                f"{torque.columns[0]} … over {asked.columns[0]} …",
                f"so the controller reckons: {{{said}}}; log: {{torque_constants: …}} in map.yaml takes them, with "
                "those of the other joints from data sheets",
            )
        )


def _constant(current: Array, torque: Array, speed: Array) -> float | None:
    """Slope of the torque over the current beside friction; None where they do not follow each other closely."""
    if not len(current) == len(torque) == len(speed):
        return None
    whole = np.isfinite(current) & np.isfinite(torque) & np.isfinite(speed)
    fastest = float(np.abs(speed[whole]).max(initial=0.0))
    if whole.sum() < 20 or fastest == 0.0 or torque[whole].std() == 0.0 or current[whole].std() == 0.0:
        return None
    v = speed[whole]
    rows = np.column_stack([current[whole], np.ones(len(v)), np.tanh(v / (_WIDTH * fastest)), v])
    answer = np.linalg.lstsq(rows, torque[whole], rcond=None)[0]
    left = torque[whole] - rows @ answer
    explained = 1.0 - float(left.var() / torque[whole].var())
    return abs(float(answer[0])) if explained > _EXPLAINED else None


# Positions and torques of motors turned into those of joints, where a map says how they are geared.

# Smaller pivots are no gear: the largest robots' ratios have some thousand.
_SINGULAR = 1e-9
_MOVED = ("q", "v", "a", "q_cmd")
_PUSHED = ("tau", "tau_cmd")


def joint_sided(table: Table, mapping: Map, joints: Sequence[str], source: object) -> Table:
    """The table with joint positions ``R⁻¹ θ`` and joint torques ``Rᵀ τ`` of motors ``θ = R q``.

    Raises:
        LogError: the matrix of the map is not square, singular, or not of the joints' number.
    """
    if not mapping.motors:
        return table
    rows = {len(row) for row in mapping.motors} | {len(mapping.motors)}
    if rows != {len(joints)}:
        raise LogError(
            f"motors: is no matrix of {len(joints)} rows and columns",
            source=source,
            remedy="one row a motor, in map.yaml",
        )
    gears = np.array(mapping.motors, dtype=float)
    if abs(np.linalg.det(gears / np.abs(gears).max())) < _SINGULAR ** len(joints):
        raise LogError("motors: cannot be inverted", source=source, remedy="correct the ratios in map.yaml")
    columns = dict(table.columns)
    for channels, matrix in ((_MOVED, np.linalg.inv(gears)), (_PUSHED, gears.T)):
        for channel in channels:
            names = [f"{channel}.{joint}" for joint in joints]
            if all(name in columns for name in names):
                values = np.column_stack([columns[name] for name in names]) @ matrix.T
                columns |= {name: values[:, k] for k, name in enumerate(names)}
    return replace(table, columns=columns)


# Whether a recording's torques can be newton metres at all, asked before anything is written.

# Two minutes at 1 kHz tell a scale, and are held beside the recording.
_MOST_ROWS = 120_000


def ask_for_scale(
    cuts: Sequence[Cut],
    header: LogHeader,
    machine: Machine,
    found: Guesses,
    stated: Map,
    recording: Recording,
) -> None:
    """Raise UnclearError where torques of no stated unit look like shares of limits, or currents, by the nominal model.

    Nothing is asked where a name, the format or the map states the torques' unit or scale.

    Args:
        cuts: the trials.
        header: header of the log that is to be written.
        machine: the robot.
        found: how the columns were understood.
        stated: the map.
        recording: the first of the recordings.
    """
    torques = found.of("tau")
    known = any(key.partition(".")[0] == "tau" for key in (*stated.units, *stated.scale))
    if not torques or known or "torque" in stated.log or any(item.unit for item in torques):
        return
    looks = _looked_at(cuts, header, machine)
    if looks is None:
        return
    cause, scale = looks
    joint = torques[0].target.partition(".")[2]
    line = f"scale: {scale}   # N·m per unit by the nominal model; or units: {{tau: N·m}} if they are N·m after all"
    what = f"{torques[0].source} … are no newton metres of the nominal masses ({joint} and others): {cause}"
    raise UnclearError([Question(what, line)], recording.source)


def _looked_at(cuts: Sequence[Cut], header: LogHeader, machine: Machine) -> tuple[str, str] | None:
    """What the first rows of the longest motion that is for identification say of the scale."""
    pairs = [
        (cut, entry) for cut, entry in zip(cuts, header.trials, strict=True) if entry.role == "identification"
    ]
    if not pairs or header.base not in ("fixed", "held"):
        return None
    cut, entry = max(pairs, key=lambda pair: len(pair[0].columns["time"]))
    columns = {name: values[:_MOST_ROWS] for name, values in cut.columns.items()}
    entry = entry.model_copy(update={"repeats": None})
    alone = header.model_copy(update={"trials": (entry,)})
    try:
        folder = TemporaryFolder()
        trial = read_columns(columns, entry, alone, Path(entry.file))
        save_log(Log(header=alone, trials=(trial,), robot_text=machine.text), folder.path / "log")
        log = load_log(folder.path / "log")
        return unknown_scale(nominal_robot(log), log)
    except (InputError, ValidationError):
        return None


# What one unit of a motor current, of a duty cycle, or of a torque of unknown unit is worth by the nominal
# weights.

# Share of a current's power that gravity and inertia have to explain before their size says anything of its scale.
_TELLING = 0.5
# Less of it does where what friction and back-EMF leave is the nominal torque but for this share of its power.
_SOME, _CLOSELY = 0.15, 0.9
# Of ten real robots whose torques are N·m, the joints that follow their model closely do so by 0.57 to 1.9, and by up
# to 3.5 on the small servos of one; amperes, shares of limits and torques before a gear are off by more on all joints.
_NO_LOAD = 3.0
# Joints whose factors lie within this of each other share one cause, such as a unit.
_SHARED = 1.3


@dataclass(frozen=True)
class Scale:
    """How a joint's torques compare with those of the nominal model.

    Attributes:
        gain: logged torque, or other unit, per N·m of the nominal model; negative where the sign is turned.
        share: share of the logged power that gravity and inertia explain beside the joint's friction.
        agreement: squared correlation with the nominal torque beside the joint's friction.
    """

    gain: float
    share: float
    agreement: float


def torque_scales(robot: Robot, log: Log) -> dict[str, Scale]:
    """Scales of the joints whose torques follow gravity and inertia closely; friction and back-EMF are beside them.

    A voltage makes the torque ``kt/R V − kt²/R ω``: the second part looks like viscous friction, kt/R is the scale.

    Args:
        robot: the nominal model.
        log: the log; of currents without constants, each ampere is taken for a newton metre.
    """
    if log.header.torque in ("none", None) or log.header.base not in ("fixed", "held"):
        return {}
    if log.header.torque == "current" and not log.header.torque_constants:
        constants = dict.fromkeys(log.header.torque_joints, 1.0)
        log = replace(log, header=log.header.model_copy(update={"torque_constants": constants}))
    try:
        samples = torque_samples(robot, log)
    except InputError:
        return {}
    if samples is None:
        return {}
    reading = Reading.as_stated(log)
    gains, shares = samples.gains(reading)
    agreements = samples.agreement(reading)
    tells = (shares > _TELLING) | ((shares > _SOME) & (agreements > _CLOSELY))
    found = zip(log.header.torque_joints, gains, shares, agreements, tells, strict=True)
    return {
        joint: Scale(float(gain), float(share), float(agreement))
        for joint, gain, share, agreement, told in found
        if told and gain != 0.0
    }


def scale_notes(robot: Robot, log: Log) -> list[str]:
    """Torque per ampere of each joint whose current the nominal model explains, and torques of another scale.

    A sentence each; nothing of it is applied, as the nominal model may be what is wrong.

    Args:
        robot: the nominal model.
        log: the log; nothing is said of one without torques and currents.
    """
    if log.header.torque in ("none", None) or log.header.base not in ("fixed", "held"):
        return []
    scales = torque_scales(robot, log)
    if log.header.torque == "current" and not log.header.torque_constants:
        if not scales:
            return ["no current follows gravity and inertia closely enough to tell torques per ampere"]
        said = [f"{joint}: {1.0 / scale.gain:.3g}" for joint, scale in scales.items()]
        return [
            "by the nominal masses, N·m per A are {" + ", ".join(said) + "}; "
            "write them under log: {torque_constants: …} in map.yaml if data sheets agree"
        ]
    off = {
        joint: scale.gain
        for joint, scale in scales.items()
        if not 1.0 / AS_STATED < abs(scale.gain) < AS_STATED
    }
    if not off:
        return []
    names = ", ".join(f"{joint} {gain:.3g}" for joint, gain in off.items())
    if load := _load(robot, log):
        return [
            f"torques are not those of the nominal masses ({names} times as large), and no scale makes them so as "
            f"well as a load does: {load.sentence()}; put it into the model if it was there"
        ]
    cause, line = _cause(off, scales, robot, log)
    return [
        f"torques are not those of the nominal masses ({names} times as large): {cause}; "
        f"scale: {line} in map.yaml would undo it"
    ]


def unknown_scale(robot: Robot, log: Log) -> tuple[str, str] | None:
    """What torques look like that are no N·m, and the ``scale`` that makes them so; None where they may be N·m.

    They are none where most joints follow the nominal model closely, each by a factor of its own or all by one, that no
    mass or load makes; and where every joint's factor is the share of its limit that drives report.

    Args:
        robot: the nominal model.
        log: the log, of torques rather than of currents.
    """
    told, joints = torque_scales(robot, log), log.header.torque_joints
    scales = {joint: scale for joint, scale in told.items() if scale.agreement > _CLOSELY}
    if 2 * len(scales) < len(joints) or log.header.torque == "current":
        return None
    gains = {joint: abs(scale.gain) for joint, scale in scales.items()}
    size = np.array(list(gains.values()))
    if not ((size < 1.0 / _NO_LOAD).all() or (size > _NO_LOAD).all()):
        if not _share_of_limits(gains, robot):
            return None
    if _load(robot, log) is not None:
        return None
    cause, line = _cause({joint: scale.gain for joint, scale in told.items()}, scales, robot, log)
    missing = "".join(f", tau.{joint}: FACTOR" for joint in joints if f"{joint}:" not in line)
    if missing and "tau:" not in line:
        line = f"{line[:-1]}{missing}}}"
    return cause, line


def _load(robot: Robot, log: Log) -> Load | None:
    """What is carried, where that explains the torques better than any scale."""
    try:
        samples = torque_samples(robot, log)
    except InputError:
        return None
    return None if samples is None else carried_load(samples, Reading.as_stated(log))


def _cause(off: dict[str, float], scales: dict[str, Scale], robot: Robot, log: Log) -> tuple[str, str]:
    """What gains that are off look like, and the ``scale`` that would undo it."""
    gears, power = _geared(off, log)
    if gears:
        ratios = ", ".join(f"{joint} {gear:.4g}" for joint, gear in gears.items())
        cause = (
            "before the model's gears, those of motors"
            if power < 0
            else "with the model's gears applied twice"
        )
        cause = f"{cause} ({ratios})"
        return cause, _scale_line({joint: gear**power for joint, gear in gears.items()})
    if share := _share_of_limits({joint: abs(scale.gain) for joint, scale in scales.items()}, robot):
        cause = f"they look like {share.name} of the model's limits of torque"
        limits = {joint: share.whole / _limit(robot, joint) for joint in log.header.torque_joints}
        return cause, _scale_line(limits)
    cause = "another side of the gear, a torque constant applied twice or not at all, or a load"
    if all(abs(gain) < 1.0 / _NO_LOAD for gain in off.values()):
        cause = "currents, whose torque constants are not known, or torques before a gear"
    return cause, _scale_line(off, alone=len(log.header.torque_joints) > len(off))


def _share_of_limits(gains: dict[str, float], robot: Robot) -> Share | None:
    return share_of_limits(
        np.array(list(gains.values())), np.array([_limit(robot, joint) for joint in gains])
    )


def _limit(robot: Robot, joint: str) -> float:
    """Largest torque of a joint [N·m or N]."""
    return float(robot.limits.torque[robot.joint_index(joint)])


def _scale_line(gains: dict[str, float], *, alone: bool = False) -> str:
    """``{tau: …}`` that undoes gains: one factor where all joints share it, else one a joint."""
    values = np.abs(list(gains.values()))
    if not alone and values.max() < _SHARED * values.min():
        return f"{{tau: {1.0 / float(np.median(values)):.3g}}}"
    return "{" + ", ".join(f"tau.{joint}: {1.0 / abs(gain):.3g}" for joint, gain in gains.items()) + "}"


def _geared(gains: dict[str, float], log: Log) -> tuple[dict[str, float], int]:
    """Gears of the log's joints, and the power of them that the gains are; empty where they are none."""
    gears = gear_ratios(log.robot_text or "")
    of_log = {joint: gears[joint] for joint in log.header.torque_joints if joint in gears}
    for power in (-1, 1):
        if all(
            joint in of_log and 1.0 / AS_STATED < abs(gain) / of_log[joint] ** power < AS_STATED
            for joint, gain in gains.items()
        ):
            return of_log, power
    return {}, 0


def gear_ratios(urdf: str) -> dict[str, float]:
    """Reductions other than one that a URDF's ``<transmission>`` elements state, by joint."""
    if "<transmission" not in urdf:
        return {}
    try:
        root = parse_xml(urdf.encode(), Path("robot.urdf"), RobotError)
    except InputError:
        return {}
    found: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joint = transmission.find("joint")
        ratio = transmission.findtext(".//mechanicalReduction", default="")
        try:
            value = abs(float(ratio))
        except ValueError:
            continue
        if joint is not None and np.isfinite(value) and value not in (0.0, 1.0):
            found[joint.get("name", "")] = value
    return found


# Questions about a recording that its torques answer, or what they make of those that stay.


@dataclass(frozen=True)
class Settled:
    """An answer that torques gave.

    Attributes:
        mapping: what a person said, and the answer.
        because: what speaks for it.
    """

    mapping: Map
    because: str


def settled_by_torques(
    questions: Sequence[Question], tried: Callable[[Map], Conversion], stated: Map
) -> Settled | None:
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
    first, *rest = question.units
    try:
        log = tried(stated.model_copy(update={"units": {**stated.units, **first}})).log
        left = _left(log, [first, *rest])
    except InputError:
        return None
    if left is None:
        return None
    odds = [left[0].odds(one) for one in left]
    best, second = np.argsort(odds)[:-3:-1]
    gain = left[second].posterior(left[best])
    none = np.zeros(len(left[0].left), dtype=bool)
    if gain < STRONG_ODDS or not explained(left[second].left, left[best].left, none):
        return None
    units = question.units[int(best)]
    said = " and ".join(dict.fromkeys(units.values()))
    because = f"{said}: so likely bodies explain the torques (by {gain:.1f} nat better than in another unit)"
    return Settled(stated.model_copy(update={"units": {**stated.units, **units}}), because)


def _left(log: Log, units: Sequence[Mapping[str, str]]) -> list[Judgement] | None:
    """What likely bodies leave of the torques with positions in each of the units, of which the first is the log's."""
    if log.header.free_base or log.header.torque in {None, "none"}:
        return None
    samples = torque_samples(nominal_robot(log), log)
    if samples is None:
        return None
    reading = Reading.as_stated(log)

    def factors(by_channel: Mapping[str, str]) -> Array:
        names = [by_channel.get(f"q.{joint}", by_channel.get("q", "rad")) for joint in log.header.joints]
        return np.array([TO_SI[name] for name in names])

    as_first = factors(units[0])
    slides = np.array([samples.slides(joint) for joint in range(len(samples.joints))])
    readings = [
        replace(reading, unit=np.where(slides, 1.0, factors(by_channel) / as_first)) for by_channel in units
    ]
    first = samples.judged(readings[0])
    return [first, *(samples.judged(read, first.counts) for read in readings[1:])]


def _with_rate(question: Question, tried: Callable[[Map], Conversion], stated: Map) -> Question:
    """The question for the rate of the rows, with the one at which inertial forces explain the torques.

    Weight does not depend on the rate, inertial forces do, with its square. Torques of either sign are tried: a turned
    one looks like no rate at all. The rate is proposed where it has an end on both sides within what any misreading has
    to bring, and where the model then explains half of the torques' power.
    """
    rates = np.geomspace(SLOWEST_HZ, FASTEST_HZ, 200)
    rate, low, high, turned = float(np.median(rates)), 0.0, 0.0, False
    for _ in range(2):
        try:
            log = tried(stated.model_copy(update={"log": {**stated.log, "rate_hz": rate}})).log
            samples = torque_samples(nominal_robot(log), log)
        except InputError:
            return question
        if samples is None or log.header.torque in (None, "none"):
            return question
        left, weights = [], []
        for sign in (1.0, -1.0):
            as_stated = Reading.as_stated(log)
            signed = replace(as_stated, torque_factor=sign * as_stated.torque_factor)
            by_clock, counts = samples.by_clock(signed), samples.judged(signed).counts
            weights.append(float(counts.sum()))
            left.append([float(counts @ by_clock(rate / one)) / weights[-1] for one in rates])
        which, at = np.unravel_index(int(np.argmin(left)), np.shape(left))
        near = np.flatnonzero(np.array(left[which]) < left[which][at] + STRONG_ODDS / weights[which])
        if near[0] == 0 or near[-1] == len(rates) - 1 or np.exp(2.0 * left[which][at]) > 0.5:
            return question
        rate, low, high, turned = float(rates[at]), float(rates[near[0]]), float(rates[near[-1]]), bool(which)
    signs = ", with the sign of the torques turned" if turned else ""
    span = f"{_two_digits(low):g} to {_two_digits(high):g}"
    why = f", as the nominal inertias say ({span} explain the torques about as well{signs})"
    return question.with_rate(_two_digits(rate), why)


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def weighed(questions: Sequence[Question], tried: Callable[[Map], Conversion], stated: Map) -> list[Question]:
    """The questions; one alone with what the nominal model makes of it: a torque per volt or duty cycle, or a rate."""
    (question,) = questions if len(questions) == 1 else (None,)
    if question is not None and question.line == RATE_LINE:
        return [_with_rate(question, tried, stated)]
    if question is None or not question.torques:
        return list(questions)
    try:
        found = tried(stated.model_copy(update={"columns": {**stated.columns, **question.torques}}))
        scales = torque_scales(nominal_robot(found.log), found.log)
    except InputError:
        scales = {}
    if not scales:
        return list(questions)
    small = any(
        target in question.torques and factor == 1e-3 for target, (_, factor) in found.columns.items()
    )
    units, unit = ("units: {tau: N·mm} and ", "N·mm") if small else ("", "N·m")
    worth = {f"tau.{joint}": f"{1.0 / scale.gain:.3g}" for joint, scale in scales.items()}
    factors = ", ".join(f"{target}: {worth.get(target, 'FACTOR')}" for target in question.torques)
    least = 100.0 * min(scale.share for scale in scales.values())
    columns = ", ".join(f'{target}: "{column}"' for target, column in question.torques.items())
    line = (
        f"columns: {{{columns}}} and {units}scale: {{{factors}}}   # {unit} per unit by the nominal "
        f"masses, whose weight and inertia are {least:.0f} % of it; or log: {{torque: none}}"
    )
    return [replace(question, line=line)]
