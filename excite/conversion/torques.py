"""What torques and currents are worth, and what they tell of units and rate, by the nominal model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from excite.arrays import Array
from excite.conversion.columns.clock import FASTEST_HZ, SLOWEST_HZ, Table
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Question, UnclearError
from excite.conversion.recording import Machine, Recording
from excite.conversion.result import Conversion
from excite.conversion.trials import Cut
from excite.doctor.channel_errors import explained
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import STRONG_ODDS, Judgement
from excite.doctor.limit_shares import AS_STATED, share_of_limits
from excite.doctor.mistakes.torques import carried_load
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.errors import InputError, LogError, RobotError
from excite.formats.documents import parse_xml
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader
from excite.logs.robot import nominal_robot
from excite.logs.units import TO_SI
from excite.robot.robot import Robot
from excite.temporary_folder import TemporaryFolder

# Two minutes at 1 kHz tell a scale, and are held beside the recording.
_MOST_ROWS = 120_000
# Share of a current's power that gravity and inertia have to explain before their size says anything of its scale.
# Less of it does where what friction and back-EMF leave is the nominal torque but for this share of its power.
_TELLING, _SOME, _CLOSELY = 0.5, 0.15, 0.9
# Of ten real robots whose torques are N·m, the joints that follow their model closely do so by 0.57 to 1.9, and by up
# to 3.5 on the small servos of one; amperes, shares of limits and torques before a gear are off by more on all joints.
_NO_LOAD = 3.0
# Joints whose factors lie within this of each other share one cause, such as a unit.
_SHARED = 1.3
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
        cuts: the trials.
        header: header of the log that is to be written.
        machine: the robot.
        found: how the columns were understood.
        stated: the map.
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
        log = load_log(folder.path / "log")
        scales = torque_scales(nominal_robot(log), log)
        cause = _unknown_scale(scales, nominal_robot(log), log)
    except (InputError, ValidationError):
        return
    if cause is not None:
        found.ask(
            "no newton metres",
            columns=f"{torques[0].source} …",
            joint=torques[0].joint,
            cause=cause.why,
            scale=cause.line,
        )
        raise UnclearError(found.questions, recording.source)


class Scale(NamedTuple):
    """How a joint's torques compare with those of the nominal model.

    Attributes:
        gain: logged torque, or other unit, per N·m of the nominal model; negative where the sign is turned.
        share: share of the logged power that gravity and inertia explain beside the joint's friction.
        agreement: squared correlation with the nominal torque beside the joint's friction.
    """

    gain: float
    share: float
    agreement: float


class Cause(NamedTuple):
    """What gains that are off look like, and the ``scale`` of a map that would undo them."""

    why: str
    line: str


def torque_scales(robot: Robot, log: Log) -> dict[str, Scale]:
    """Scales of the joints whose torques follow gravity and inertia closely; friction and back-EMF are beside them.

    A voltage makes the torque ``kt/R V − kt²/R ω``: the second part looks like viscous friction, kt/R is the scale.

    Args:
        robot: the nominal model.
        log: the log; of currents without constants, each ampere is taken for a newton metre.
    """
    if log.header.torque == "current" and not log.header.torque_constants:
        constants = dict.fromkeys(log.header.torque_joints, 1.0)
        log = replace(log, header=log.header.model_copy(update={"torque_constants": constants}))
    samples, reading = _samples(robot, log), Reading.as_stated(log)
    if samples is None:
        return {}
    rows = zip(*samples.gains(reading), samples.agreement(reading), strict=True)
    found = {
        joint: Scale(*map(float, row)) for joint, row in zip(log.header.torque_joints, rows, strict=True)
    }
    return {
        joint: scale
        for joint, scale in found.items()
        if scale.gain and (scale.share > _TELLING or (scale.share > _SOME and scale.agreement > _CLOSELY))
    }


def _samples(robot: Robot, log: Log) -> TorqueSamples | None:
    """Samples of the torques of an arm; None where there are none."""
    if log.header.torque in ("none", None) or log.header.base not in ("fixed", "held"):
        return None
    try:
        return torque_samples(robot, log)
    except InputError:
        return None


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
        said = ", ".join(f"{joint}: {1.0 / scale.gain:.3g}" for joint, scale in scales.items())
        return [
            f"by the nominal masses, N·m per A are {{{said}}}; "
            "write them under log: {torque_constants: …} in map.yaml if data sheets agree"
        ]
    off = {j: scale.gain for j, scale in scales.items() if not 1.0 / AS_STATED < abs(scale.gain) < AS_STATED}
    if not off:
        return []
    names = ", ".join(f"{joint} {gain:.3g}" for joint, gain in off.items())
    first = f"torques are not those of the nominal masses ({names} times as large)"
    if load := _load(robot, log):
        return [
            f"{first}, and no scale makes them so as well as a load does: {load}; put it into the model if it was there"
        ]
    cause = _cause(off, scales, robot, log)
    return [f"{first}: {cause.why}; scale: {cause.line} in map.yaml would undo it"]


def _unknown_scale(told: dict[str, Scale], robot: Robot, log: Log) -> Cause | None:
    """What torques look like that are no N·m; None where they may be.

    They are none where most joints follow the nominal model closely, each by a factor of its own or all by one, that no
    mass or load makes; and where every joint's factor is the share of its limit that drives report.
    """
    joints = log.header.torque_joints
    scales = {joint: scale for joint, scale in told.items() if scale.agreement > _CLOSELY}
    if 2 * len(scales) < len(joints) or log.header.torque == "current":
        return None
    size = np.array([abs(scale.gain) for scale in scales.values()])
    off = (size < 1.0 / _NO_LOAD).all() or (size > _NO_LOAD).all()
    if not (off or share_of_limits(size, _limits(robot, list(scales)))) or _load(robot, log):
        return None
    cause = _cause({joint: scale.gain for joint, scale in told.items()}, scales, robot, log)
    missing = "".join(f", tau.{joint}: FACTOR" for joint in joints if f"{joint}:" not in cause.line)
    return cause if "tau:" in cause.line else cause._replace(line=f"{cause.line[:-1]}{missing}}}")


def _load(robot: Robot, log: Log) -> str:
    """What is carried, where that explains the torques better than any scale; empty for nothing."""
    samples = _samples(robot, log)
    load = None if samples is None else carried_load(samples, Reading.as_stated(log))
    return "" if load is None else load.sentence()


def _cause(off: dict[str, float], scales: dict[str, Scale], robot: Robot, log: Log) -> Cause:
    """What gains that are off look like: the other side of the model's gears, shares of its limits, currents."""
    joints = log.header.torque_joints
    gears = {joint: gear for joint, gear in gear_ratios(log.robot_text or "").items() if joint in joints}
    ratios = ", ".join(f"{joint} {gear:.4g}" for joint, gear in gears.items())
    for power, why in (
        (-1, "before the model's gears, those of motors"),
        (1, "with the model's gears applied twice"),
    ):
        ratio = [abs(gain) / gears[joint] ** power if joint in gears else 0.0 for joint, gain in off.items()]
        if all(1.0 / AS_STATED < one < AS_STATED for one in ratio):
            return Cause(f"{why} ({ratios})", _scale_line({j: gear**power for j, gear in gears.items()}))
    size = np.array([abs(scale.gain) for scale in scales.values()])
    if share := share_of_limits(size, _limits(robot, list(scales))):
        gains = dict(zip(joints, share.whole / _limits(robot, joints), strict=True))
        return Cause(f"they look like {share.name} of the model's limits of torque", _scale_line(gains))
    why = "another side of the gear, a torque constant applied twice or not at all, or a load"
    if all(abs(gain) < 1.0 / _NO_LOAD for gain in off.values()):
        why = "currents, whose torque constants are not known, or torques before a gear"
    return Cause(why, _scale_line(off, alone=len(joints) > len(off)))


def _limits(robot: Robot, joints: Sequence[str]) -> Array:
    """Largest torques of joints [N·m or N]."""
    return np.array([float(robot.limits.torque[robot.joint_index(joint)]) for joint in joints])


def _scale_line(gains: Mapping[str, float], *, alone: bool = False) -> str:
    """``{tau: …}`` that undoes gains: one factor where all joints share it, else one a joint."""
    values = np.abs(list(gains.values()))
    if not alone and values.max() < _SHARED * values.min():
        return f"{{tau: {1.0 / float(np.median(values)):.3g}}}"
    return "{" + ", ".join(f"tau.{joint}: {1.0 / abs(gain):.3g}" for joint, gain in gains.items()) + "}"


def gear_ratios(urdf: str) -> dict[str, float]:
    """Reductions other than one that a URDF's ``<transmission>`` elements state, by joint."""
    if "<transmission" not in urdf:
        return {}
    found: dict[str, float] = {}
    try:
        for transmission in parse_xml(urdf.encode(), Path("robot.urdf"), RobotError).findall("transmission"):
            joint, ratio = transmission.find("joint"), transmission.findtext(".//mechanicalReduction", "0")
            number = ratio.strip().lstrip("+-").replace(".", "", 1).isdigit()
            if joint is not None and number and (value := abs(float(ratio))) not in (0.0, 1.0):
                found[joint.get("name", "")] = value
    except InputError:
        return {}
    return found


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
    slides = np.array([samples.slides(joint) for joint in range(len(samples.joints))])
    reading = Reading.as_stated(log)
    readings = [replace(reading, unit=np.where(slides, 1.0, size / sizes[0])) for size in sizes]
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
        scales = torque_scales(nominal_robot(found.log), found.log)
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
            left.append([float(counts @ by_clock(rates[at] / one)) / counts.sum() for one in rates])
        # The first trial's rate is a guess, by which its samples were taken.
        which, at = (int(k) for k in np.unravel_index(int(np.argmin(left)), np.shape(left)))
        near = np.flatnonzero(np.array(left[which]) < left[which][at] + STRONG_ODDS / counts.sum())
        if near[0] == 0 or near[-1] == len(rates) - 1 or np.exp(2.0 * left[which][at]) > 0.5:
            return question
    rate, low, high = (float(f"{one:.2g}") for one in (rates[at], rates[near[0]], rates[near[-1]]))
    signs = ", with the sign of the torques turned" if which else ""
    why = f", as the nominal inertias say ({low:g} to {high:g} explain the torques about as well{signs})"
    return question.with_rate(rate, why)
