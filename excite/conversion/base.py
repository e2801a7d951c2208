"""What is known of a robot's base: its pose, the readings of its IMU, and contact wrenches under the sensors' names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from excite.conversion.columns.joints import match_labels
from excite.conversion.columns.words import Clue
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Column, Recording
from excite.logs.robot import foot_headers, sensor_headers

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
