"""Signals of a floating base: pose, IMU readings, contact flags and contact wrenches."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.conversion.columns.families import POSE_AXES, quaternion_order, unit_quaternions
from excite.conversion.columns.joints import match_labels
from excite.conversion.columns.vocabulary import MEASURED
from excite.conversion.columns.words import Clue, name_tokens
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Column, Machine, Recording
from excite.logs.robot import foot_headers, sensor_headers

# Columns of a base that moves, by their names: its pose, the readings of its IMU, and which feet carry.

_BASE = frozenset("base root trunk torso pelvis body floating freeflyer odom odometry".split())
_IMU = frozenset("imu ins ahrs".split())
# What else stands in such names and says nothing: middleware's levels, frames (_w: of the world, _b: of the body).
_FILLERS = MEASURED | frozenset(
    "link frame pose state data world w b link0 robot mocap vicon optitrack wxyz xyzw message msg linear fb "
    "transform tf kin value lin".split()
)
_KINDS: dict[str, frozenset[str]] = {
    "position": frozenset("pos position positions translation xyz location trans p".split()),
    "quaternion": frozenset(
        "quat quats quaternion quaternions orientation orient rot rotation ori attitude att q".split()
    ),
    "gyro": frozenset("gyro gyroscope gyr omega angvel angular ang vel velocity g rate".split()),
    "accelerometer": frozenset("acc accel accelerometer acceleration accelerations a".split()),
}
# Words that say by themselves which of the IMU's readings it is, and do not stand for a derivative of a pose.
_ALONE = {"gyro": frozenset("gyro gyroscope gyr".split()), "accelerometer": frozenset(("accelerometer",))}
_TURNING = frozenset("gyro gyroscope gyr omega angvel angular ang".split())
_AXES = {"position": "xyz", "quaternion": "wxyz", "gyro": "xyz", "accelerometer": "xyz"}
# base_px, base_qw, imu_gx, imu_ax.
_SHORT = {"p": "position", "q": "quaternion", "g": "gyro", "a": "accelerometer"}
_CONTACT = frozenset("contact contacts touch stance incontact touching grounded touchdown".split())
_OF_FOOT = frozenset("foot feet leg flag flags sensor in on is state phase".split()) | MEASURED


@dataclass(frozen=True)
class _Signal:
    """What one name says: the kind, whose, and the axis by letter or number."""

    kind: str
    words: frozenset[str]
    rest: str
    axis: str


def add_base_signals(
    found: Guesses, recording: Recording, names: Sequence[str], feet: Sequence[tuple[str, str]]
) -> None:
    """Add the channels ``base.*``, ``imu.*`` and ``contact.*`` whose columns are called so.

    A group is taken where it is whole: three axes, four numbers that are a quaternion in every row, or a flag of 0 or
    1 for every foot. A commanded pose, an estimate of a hand, or a velocity of the base is none of these.

    Args:
        found: what is known; channels that it has are left as they are.
        recording: the columns.
        names: columns that nothing is known of yet.
        feet: name and link of the robot's feet; none where they are not known.
    """
    there = set(names)
    for stream in recording.streams:
        columns = [c for c in stream.columns if c.name in there and not c.channel]
        groups = _group_axes(columns)
        if not found.of("base"):
            _add_pose(found, groups)
        if not found.of("imu"):
            _add_imu(found, groups)
        if feet and not found.of("contact"):
            _add_contacts(found, columns, feet)


def _add_pose(found: Guesses, groups: dict[tuple[str, str], list[Column]]) -> None:
    for (kind, rest), columns in groups.items():
        places = groups.get(("position", rest)) or next(
            (group for (other, _), group in groups.items() if other == "position"), None
        )
        if kind != "quaternion" or places is None:
            continue
        turns = np.column_stack([column.values for column in columns])
        if not unit_quaternions(turns):
            continue
        order = "wxyz"
        if not _is_lettered(columns):
            told = "wxyz" if "wxyz" in rest else "xyzw" if "xyzw" in rest else quaternion_order(turns)
            if told is None:
                line = f'columns: {{base.qw: "{columns[0].name}", base.qx: "{columns[1].name}", …}}'
                found.ask(f"which end of {columns[0].name} … is w cannot be told", line)
                return
            order = told
        pairs = zip(("px", "py", "pz", *POSE_AXES[order]), (*places, *columns), strict=True)
        found.mapped += [Mapped(f"base.{axis}", c.name, 1.0, f"its name, {order}") for axis, c in pairs]
        return


def _add_imu(found: Guesses, groups: dict[tuple[str, str], list[Column]]) -> None:
    gyro, read = (
        next((g for (k, _), g in groups.items() if k == kind), None) for kind in ("gyro", "accelerometer")
    )
    if gyro is None or read is None:
        return
    axes = zip(("gx", "gy", "gz", "ax", "ay", "az"), (*gyro, *read), strict=True)
    found.mapped += [Mapped(f"imu.{axis}", c.name, 1.0, "its name") for axis, c in axes]


def _add_contacts(found: Guesses, columns: Sequence[Column], feet: Sequence[tuple[str, str]]) -> None:
    flags = {}
    for column in columns:
        words = name_tokens(column.name)
        if _CONTACT & set(words) and bool(
            np.isin(column.values[np.isfinite(column.values)], (0.0, 1.0)).all()
        ):
            flags[column.name] = [word for word in words if word not in _CONTACT | _OF_FOOT]
    if len(flags) != len(feet):
        return
    numbers = [int(words[0]) for words in flags.values() if len(words) == 1 and words[0].isdigit()]
    if len(numbers) == len(flags) == len(set(numbers)):
        ordered = [name for _, name in sorted(zip(numbers, flags, strict=True))]
        foot_of = dict(zip([name for name, _ in feet], ordered, strict=True))
        because = "its name; foot by its number, in the robot's order of feet"
    else:
        foot_of, because = _by_words(flags, feet), "its name; foot by the foot's name"
    found.mapped += [Mapped(f"contact.{foot}", name, 1.0, because) for foot, name in foot_of.items()]


def _by_words(flags: dict[str, list[str]], feet: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Columns by foot, by the words of the feet's names and links; {} where these leave a foot open."""
    labels = {" ".join(words): name for name, words in flags.items()}
    named = {f"{foot} {link}": foot for foot, link in feet}
    found = match_labels(list(labels), list(named))
    if found is None or len(found.placed) < len(feet):
        return {}
    return {named[foot]: labels[label] for foot, label in found.placed.items()}


def _group_axes(columns: Sequence[Column]) -> dict[tuple[str, str], list[Column]]:
    """Whole groups of axes by kind and by the rest of their names, axes in order."""
    parts: dict[tuple[str, str], dict[str, Column]] = {}
    for column in columns:
        for said in _possible_signals(column.name):
            parts.setdefault((said.kind, said.rest), {}).setdefault(said.axis, column)
    whole = {}
    for (kind, rest), axes in parts.items():
        letters = _AXES[kind]
        for order in (letters, [str(k) for k in range(len(letters))]):
            if set(axes) == set(order):
                whole[kind, rest] = [axes[axis] for axis in order]
    return whole


def _is_lettered(columns: Sequence[Column]) -> bool:
    return name_tokens(columns[0].name)[-1].endswith("w")


def _possible_signals(name: str) -> Iterator[_Signal]:
    """What a name may say, for each kind that it fits."""
    words = name_tokens(name)
    if len(words) < 2:
        return
    *rest, last = words
    if short := re.fullmatch(r"([pqga])([xyzw])", last):
        rest, last = [*rest, _SHORT[short[1]]], short[2]
        kinds = {_SHORT[short[1]]: frozenset((_SHORT[short[1]],))}
    else:
        kinds = _KINDS
    if last not in ("x", "y", "z", "w") and not last.isdigit():
        return
    said = frozenset(rest)
    for kind, own in kinds.items():
        if said - own - _FILLERS - _BASE - _IMU:
            continue
        whose = said & (_IMU if kind in _ALONE else _BASE)
        if kind in _ALONE:
            fits = bool(said & own) and bool(whose or (kinds is _KINDS and said & _ALONE[kind]))
            fits &= kind != "gyro" or bool(said & _TURNING)
        elif kind == "position":
            # base_x, base_pos_x; a quaternion's axes are not these.
            fits = (
                bool(whose)
                and (bool(said & own) or last in ("x", "y", "z"))
                and not said & _KINDS["quaternion"]
            )
        else:
            fits = bool(whose) and bool(said & own)
        if fits:
            of_whom = " ".join(sorted(said - own - MEASURED)) if kind in ("position", "quaternion") else ""
            yield _Signal(kind, said, of_whom, last)


# What is known of a robot's base: its pose, the readings of its IMU, and contact wrenches under the sensors'
# names.

_FRAME = "on_robot_in_sensor_frame"


def add_base(
    found: Guesses, recording: Recording, clues: dict[str, Clue], machine: Machine, mapping: Map
) -> None:
    """Channels of the base and of contact wrenches, where the format itself says them and the log can use them."""
    columns = [c for stream in recording.streams for c in stream.columns if c.name in clues]
    _add_channels(found, [(f"base.{c.label}", c) for c in columns if c.channel == "base"])
    if "imu" in mapping.log or _imu_block(machine) is not None:
        _add_channels(found, [(f"imu.{c.label}", c) for c in columns if c.channel == "imu"])
    _add_wrenches(found, [c for c in columns if c.channel == "wrench"], machine, mapping)


def base_fields(
    present: set[str], found: Guesses, machine: Machine, stated: dict[str, Any]
) -> dict[str, Any]:
    """Fields of ``log.yaml`` for a base whose pose or inertial readings were logged; empty for none."""
    imu = _imu_block(machine) if "imu.gx" in present else None
    fields: dict[str, Any] = {} if imu is None or "imu" in stated else {"imu": imu}
    feet = [] if machine.robot is None else foot_headers(machine.robot)
    feet = [foot for foot in feet if f"contact.{foot.name}" in present]
    posed = "base.px" in present
    if not posed and not (feet and "imu.gx" in present):
        return fields
    fields |= {"base": "suspended", "base_link": machine.base_link}
    because = "a base pose was logged, and no contact wrench"
    sensors = [s for s in _known_sensors(machine, stated) if f"wrench.{s['name']}.fx" in present]
    if sensors:
        fields |= {"base": "floating", "wrench": _FRAME, "sensors": sensors}
        because = "a base pose and contact wrenches were logged"
        found.facts.append(("wrench", _FRAME, "what ankle sensors and plates say after their drivers"))
    if feet and "feet" not in stated:
        fields |= {"base": "floating", "feet": [foot.model_dump() for foot in feet]}
    if feet and not sensors and "feet" not in stated:
        because = f"{'a base pose' if posed else 'readings of an IMU'} and contact flags were logged"
    if "base" not in stated:
        found.facts.append(("base", fields["base"], because))
    return fields


def feet_of(found: Guesses, machine: Machine, mapping: Map) -> list[tuple[str, str]]:
    """Name and link of the feet that flags of contact may be of; asks where a map names one that the robot lacks."""
    stated = mapping.log.get("feet") or ()
    feet = [(str(f["name"]), str(f.get("link", ""))) for f in stated if isinstance(f, dict) and "name" in f]
    if not feet and machine.robot is not None:
        feet = [(foot.name, foot.link) for foot in foot_headers(machine.robot)]
    names = [name for name, _ in feet]
    strange = [item.target for item in found.of("contact") if item.target.partition(".")[2] not in names]
    if strange and names:
        line = f'columns: {{contact.{names[0]}: "NAME", …}}'
        found.ask(
            f"{', '.join(strange)} is of no foot of {machine.name}, whose feet are {', '.join(names)}", line
        )
    return feet


def _add_channels(found: Guesses, pairs: Sequence[tuple[str, Column]]) -> None:
    known = {item.target for item in found.mapped}
    for target, column in pairs:
        if target not in known:
            found.mapped.append(Mapped(target, column.name, 1.0, "the format says so"))
            known.add(target)


def _add_wrenches(found: Guesses, columns: Sequence[Column], machine: Machine, mapping: Map) -> None:
    groups: dict[str, list[Column]] = {}
    for column in columns:
        groups.setdefault(column.label.rpartition(".")[0], []).append(column)
    sensors = [str(sensor["name"]) for sensor in _known_sensors(machine, mapping.log)]
    same = {name: name for name in groups if name in sensors}
    rest = [name for name in groups if name not in same]
    free = [name for name in sensors if name not in same.values()]
    like = match_labels(rest, free) if rest and free else None
    same |= {} if like is None else {name: sensor for sensor, name in like.placed.items()}
    for name, sensor in same.items():
        axes = [(f"wrench.{sensor}.{c.label.rpartition('.')[2]}", c) for c in groups[name]]
        _add_channels(found, axes)
    strange = [name for name in groups if name not in same]
    if not strange:
        return
    if found.of("base") and not sensors and mapping.log.get("base") in (None, "floating"):
        found.ask(
            f"contact wrenches {', '.join(strange)} were recorded, and where their sensors sit is not known",
            f"log: {{wrench: {_FRAME}, sensors: [{{name: {strange[0]}, kind: foot_ft, parent: LINK, foot: LINK, "
            f'excludes: [LINK]}}]}}, or ignore: ["{strange[0]}*"]',
        )
        return
    found.facts.append(
        ("wrench", ", ".join(strange), "left out: no contact sensor of the robot has such a name")
    )


def _known_sensors(machine: Machine, stated: dict[str, Any]) -> list[dict[str, Any]]:
    """Sensors that a map states, else those of the robot's description."""
    if "sensors" in stated:
        return [sensor for sensor in stated["sensors"] or () if isinstance(sensor, dict) and "name" in sensor]
    if machine.robot is None or not machine.floating:
        return []
    return [sensor.model_dump() for sensor in sensor_headers(machine.robot)]


def _imu_block(machine: Machine) -> dict[str, Any] | None:
    if machine.robot is None or not machine.floating:
        return None
    block = machine.robot.description.sensors.imu
    return None if block is None else block.model_dump()
