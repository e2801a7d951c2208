"""What one unit of a motor current, of a duty cycle, or of a torque of unknown unit is worth by the nominal weights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.doctor.limit_shares import AS_STATED, Share, share_of_limits
from excite.doctor.mistakes.carried_load import Load, carried_load
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.errors import InputError, RobotError
from excite.logs.log import Log
from excite.reading.xml_document import parse_xml
from excite.robot.robot import Robot

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
