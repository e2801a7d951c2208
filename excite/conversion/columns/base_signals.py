"""Signals of a floating base: pose, IMU readings, contact flags and contact wrenches."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np

from excite.conversion.columns.families import POSE_AXES, is_quaternion, quaternion_order
from excite.conversion.columns.joints import match_labels
from excite.conversion.columns.vocabulary import MEASURED
from excite.conversion.columns.words import Clue, name_tokens
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Mapped, message
from excite.conversion.recording import Column, Machine, Recording
from excite.data_tables import read_rows
from excite.logs.robot import foot_headers, sensor_headers


class _Kind(NamedTuple):
    """What a column of a base may hold.

    Attributes:
        short: letter of short names: base_px, base_qw, imu_gx, imu_ax.
        axes: letters of its axes; columns may be numbered instead.
        words: of which one says it, whose it is being said too.
        alone: words that say it by themselves.
        beside: words that may stand beside those.
        of_imu: whether it is the IMU's rather than the base's.
    """

    short: str
    axes: str
    words: frozenset[str]
    alone: frozenset[str] = frozenset()
    beside: frozenset[str] = frozenset()
    of_imu: bool = False


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_KINDS = {
    row["kind"]: _Kind(
        row["short"],
        row["axes"],
        _words(row["words"]),
        _words(row["alone"]),
        _words(row["beside"]),
        bool(row["of_imu"]),
    )
    for row in read_rows(__file__, "base_signals.csv")
}
_BASE = _words("base root trunk torso pelvis body floating freeflyer odom odometry")
_IMU = _words("imu ins ahrs")
# What else stands in such names and says nothing: middleware's levels, frames (_w: of the world, _b: of the body).
_FILLERS = MEASURED | _words(
    "link frame pose state data world w b link0 robot mocap vicon optitrack wxyz xyzw message msg linear fb "
    "transform tf kin value lin"
)
_CONTACT = _words("contact contacts touch stance incontact touching grounded touchdown")
_OF_FOOT = _words("foot feet leg flag flags sensor in on is state phase") | MEASURED
_FRAME = "on_robot_in_sensor_frame"


def add_base_signals(
    found: Guesses, recording: Recording, names: Sequence[str], feet: Sequence[tuple[str, str]]
) -> None:
    """Add the channels ``base.*``, ``imu.*`` and ``contact.*`` whose columns are called so.

    A group is taken where it is whole: three axes, four numbers that are a quaternion in every row, or a flag of 0 or
    1 for every foot. A commanded pose, an estimate of a hand, or a velocity of the base is none of these.

    Args:
        found: what is known; channels that it has are left as they are.
        names: columns that nothing is known of yet.
        feet: name and link of the robot's feet; none where they are not known.
    """
    for stream in recording.streams:
        columns = [c for c in stream.columns if c.name in set(names) and not c.channel]
        groups = _group_axes(columns)
        by_kind = {kind: group for (kind, _), group in reversed(groups.items())}
        if not found.of("base"):
            _add_pose(found, groups, by_kind.get("position"))
        if not found.of("imu") and {"gyro", "accelerometer"} <= set(by_kind):
            axes = zip(
                ("gx", "gy", "gz", "ax", "ay", "az"), by_kind["gyro"] + by_kind["accelerometer"], strict=True
            )
            found.mapped += [Mapped(f"imu.{axis}", c.name, 1.0, "its name") for axis, c in axes]
        if feet and not found.of("contact"):
            _add_contacts(found, columns, feet)


def _add_pose(
    found: Guesses, groups: dict[tuple[str, str], list[Column]], first: list[Column] | None
) -> None:
    for (kind, rest), columns in groups.items():
        places = groups.get(("position", rest), first)
        turns = np.column_stack([column.values for column in columns])
        if kind != "quaternion" or places is None or not is_quaternion(turns):
            continue
        lettered = name_tokens(columns[0].name)[-1].endswith("w")
        said = next((order for order in POSE_AXES if order in rest), None)
        order = "wxyz" if lettered else said or quaternion_order(turns)
        if order is None:
            w, x = columns[0].name, columns[1].name
            found.ask("order of quaternion", column=w, w=w, x=x)
            return
        pairs = zip(("px", "py", "pz", *POSE_AXES[order]), (*places, *columns), strict=True)
        found.mapped += [Mapped(f"base.{axis}", c.name, 1.0, f"its name, {order}") for axis, c in pairs]
        return


def _add_contacts(found: Guesses, columns: Sequence[Column], feet: Sequence[tuple[str, str]]) -> None:
    flags = {}
    for column in columns:
        words = name_tokens(column.name)
        if _CONTACT & set(words) and np.isin(column.values[np.isfinite(column.values)], (0.0, 1.0)).all():
            flags[column.name] = " ".join(word for word in words if word not in _CONTACT | _OF_FOOT)
    if len(flags) != len(feet):
        return
    if all(label.isdigit() for label in flags.values()) and len(set(flags.values())) == len(flags):
        ordered = sorted(flags, key=lambda name: int(flags[name]))
        foot_of = dict(zip([name for name, _ in feet], ordered, strict=True))
        because = "its name; foot by its number, in the robot's order of feet"
    else:
        named, labels = {f"{foot} {link}": foot for foot, link in feet}, {flags[name]: name for name in flags}
        match = match_labels(list(labels), list(named))
        placed = {} if match is None or len(match.columns) < len(feet) else match.columns
        foot_of = {named[foot]: labels[label] for foot, label in placed.items()}
        because = "its name; foot by the foot's name"
    found.mapped += [Mapped(f"contact.{foot}", name, 1.0, because) for foot, name in foot_of.items()]


def _group_axes(columns: Sequence[Column]) -> dict[tuple[str, str], list[Column]]:
    """Whole groups of axes by kind and by the rest of their names, axes in order."""
    parts: dict[tuple[str, str], dict[str, Column]] = {}
    for column in columns:
        for kind, rest, axis in _possible_signals(column.name):
            parts.setdefault((kind, rest), {}).setdefault(axis, column)
    whole = {}
    for (kind, rest), axes in parts.items():
        letters = _KINDS[kind].axes
        for order in (letters, "0123"[: len(letters)]):
            if set(axes) == set(order):
                whole[kind, rest] = [axes[axis] for axis in order]
    return whole


def _possible_signals(name: str) -> Iterator[tuple[str, str, str]]:
    """What a name may say, for each kind that it fits: the kind, whose, and the axis by letter or number."""
    *rest, last = name_tokens(name) or [""]
    short = re.fullmatch(r"([pqga])([xyzw])", last)
    letter, last = (short[1], short[2]) if short else ("", last)
    if not rest or (last not in ("x", "y", "z", "w") and not last.isdigit()):
        return
    said = frozenset(rest)
    for name_of_kind, kind in _KINDS.items():
        if (letter and kind.short != letter) or said - kind.words - kind.beside - _FILLERS - _BASE - _IMU:
            continue
        whose = bool(said & (_IMU if kind.of_imu else _BASE))
        says = bool(letter or said & kind.words)
        # base_x is its position.
        says |= (
            name_of_kind == "position" and last in ("x", "y", "z") and not said & _KINDS["quaternion"].words
        )
        if (whose and says) or (said & kind.alone and not letter):
            rest_of = "" if kind.of_imu else " ".join(sorted(said - kind.words - MEASURED))
            yield name_of_kind, rest_of, last


def add_base(
    found: Guesses, recording: Recording, clues: dict[str, Clue], machine: Machine, mapping: Map
) -> None:
    """Channels of the base and of contact wrenches, where the format itself says them and the log can use them."""
    columns = [c for c in recording.columns if c.name in clues]
    channels = ("base", "imu") if "imu" in mapping.log or _imu_block(machine) is not None else ("base",)
    for column in columns:
        if column.channel in channels:
            _add_channel(found, f"{column.channel}.{column.label}", column)
    groups: dict[str, list[Column]] = {}
    for column in columns:
        if column.channel == "wrench":
            groups.setdefault(column.label.rpartition(".")[0], []).append(column)
    sensors = [str(sensor["name"]) for sensor in _known_sensors(machine, mapping.log)]
    of = {name: name for name in groups if name in sensors}
    rest, free = [n for n in groups if n not in of], [n for n in sensors if n not in of]
    like = match_labels(rest, free) if rest and free else None
    of |= {} if like is None else {name: sensor for sensor, name in like.columns.items()}
    for name, sensor in of.items():
        for column in groups[name]:
            _add_channel(found, f"wrench.{sensor}.{column.label.rpartition('.')[2]}", column)
    strange = [name for name in groups if name not in of]
    if strange and found.of("base") and not sensors and mapping.log.get("base") in (None, "floating"):
        found.ask("wrenches", names=", ".join(strange), frame=_FRAME, name=strange[0])
    elif strange:
        found.note("wrenches of no sensor", names=", ".join(strange))


def _add_channel(found: Guesses, target: str, column: Column) -> None:
    if target not in {item.target for item in found.mapped}:
        found.mapped.append(Mapped(target, column.name, 1.0, "the format says so"))


def base_fields(
    present: set[str], found: Guesses, machine: Machine, stated: dict[str, Any]
) -> dict[str, Any]:
    """Fields of ``log.yaml`` for a base whose pose or inertial readings were logged; empty for none."""
    imu = _imu_block(machine) if "imu.gx" in present else None
    fields: dict[str, Any] = {} if imu is None or "imu" in stated else {"imu": imu}
    feet = [] if machine.robot is None else foot_headers(machine.robot)
    by_torques = tells_contacts({name.partition(".")[0] for name in present}, machine, stated)
    feet = [foot for foot in feet if by_torques or f"contact.{foot.name}" in present]
    posed = "base.px" in present
    if not posed and not (feet and "imu.gx" in present):
        return fields
    fields |= {"base": "suspended", "base_link": machine.base_link}
    because = "pose alone"
    sensors = [s for s in _known_sensors(machine, stated) if f"wrench.{s['name']}.fx" in present]
    if feet and "feet" not in stated:
        fields |= {"base": "floating", "feet": [foot.model_dump() for foot in feet]}
        because = "pose and flags" if posed else "imu and torques" if by_torques else "imu and flags"
    if sensors:
        fields |= {"base": "floating", "wrench": _FRAME, "sensors": sensors}
        because = "pose and wrenches"
        found.note("frame of wrenches", frame=_FRAME)
    if "base" not in stated:
        found.note("base as logged", base=fields["base"], because=message("why of the base", because))
    return fields


def tells_contacts(channels: Set[str], machine: Machine, stated: Mapping[str, Any]) -> bool:
    """Whether torques and an IMU have to tell which feet carry, as nothing else does."""
    known = stated.get("base", "floating") == "floating" and (
        "imu" in stated or _imu_block(machine) is not None
    )
    footed = machine.robot is not None and bool(machine.robot.feet)
    alone = {"imu", "tau"} <= channels and not channels & {"base", "contact", "wrench"}
    return known and footed and alone and stated.get("torque") not in ("none", "current")


def feet_of(found: Guesses, machine: Machine, mapping: Map) -> list[tuple[str, str]]:
    """Name and link of the feet that flags of contact may be of; asks where a map names one that the robot lacks."""
    stated = mapping.log.get("feet") or ()
    feet = [(str(f["name"]), str(f.get("link", ""))) for f in stated if isinstance(f, dict) and "name" in f]
    if not feet and machine.robot is not None:
        feet = [(foot.name, foot.link) for foot in foot_headers(machine.robot)]
    names = [name for name, _ in feet]
    strange = [item.target for item in found.of("contact") if item.joint not in names]
    if strange and names:
        found.ask(
            "unknown foot", names=", ".join(strange), robot=machine.name, feet=", ".join(names), foot=names[0]
        )
    return feet


def _known_sensors(machine: Machine, stated: dict[str, Any]) -> list[dict[str, Any]]:
    """Sensors that a map states, else those of the robot's description."""
    if "sensors" in stated:
        return [sensor for sensor in stated["sensors"] or () if isinstance(sensor, dict) and "name" in sensor]
    if machine.robot is None or not machine.floating:
        return []
    return [sensor.model_dump() for sensor in sensor_headers(machine.robot)]


def _imu_block(machine: Machine) -> dict[str, Any] | None:
    block = machine.robot.description.sensors.imu if machine.robot is not None and machine.floating else None
    return None if block is None else block.model_dump()
