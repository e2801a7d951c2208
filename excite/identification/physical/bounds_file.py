"""Files of bounds of physical parameters, ``excite.physical_bounds/1``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.errors import InputError, RobotError
from excite.formats.documents import read_yaml
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.settings import BodySettings
from excite.identification.physical.bounds import Interval, KnownBounds
from excite.identification.physical.coordinates import NAMES
from excite.identification.physical.default_bounds import default_bounds
from excite.robot.quantities import MAX_INERTIA
from excite.robot.robot import Robot
from excite.robot.shapes.com_box import com_boxes
from excite.rows.drive_terms import DRIVE_TERMS

SCHEMA = "excite.physical_bounds/1"
_AXES = ("x", "y", "z")
_FIELDS = ("schema", "source", "total_mass", "rules", "links", "drives", "parameters")
_POSITIVE = ("m", "Ixx", "Iyy", "Izz")


def load_bounds(path: str | Path, robot: Robot) -> KnownBounds:
    """Read what a file ``excite.physical_bounds/1`` says of a robot; it may leave out whatever is not known.

    ``links: {LINK: {m: [lower, upper], cx: …}}``, ``drives: {viscous.JOINT: […]}``, ``total_mass: […]`` and
    ``rules``; ``parameters: {LINK.m: […]}`` says the same in one level.

    Args:
        path: the YAML file.
        robot: the robot; names are checked against it.

    Returns:
        The bounds, checked against the robot.

    Raises:
        InputError: malformed, not finite or empty bounds, or of something that the robot does not have; names
            the file, the field and what to do.
    """
    path = Path(path)
    links = tuple(segment.link for segment in robot.segments)
    known = _known_bounds(path, _read_bounds_document(path), links)
    for name in known.drives:
        term, _, joint = name.partition(".")
        if term not in DRIVE_TERMS or joint not in robot.joint_names:
            raise InputError(
                "is no parameter of the robot",
                source=path,
                field=name,
                remedy=f"write TERM.JOINT with {' or '.join(DRIVE_TERMS)} and one of the joints "
                + ", ".join(robot.joint_names),
            )
    return known


def _read_bounds_document(path: Path) -> dict[str, Any]:
    document = read_yaml(path, remedy=f"start it with schema: {SCHEMA}")
    if document.get("schema") != SCHEMA:
        raise InputError(
            "is not a bounds file", source=path, field="schema", remedy=f"start it with schema: {SCHEMA}"
        )
    for key in document:
        if key not in _FIELDS:
            raise InputError("is unknown", source=path, field=str(key), remedy="choose " + ", ".join(_FIELDS))
    if not any(document.get(key) for key in _FIELDS[2:]):
        raise InputError("bounds nothing", source=path, remedy="give links, drives or total_mass")
    return document


def _known_bounds(path: Path, document: dict[str, Any], links: tuple[str, ...]) -> KnownBounds:
    parameters: dict[str, Interval] = {}
    drives: dict[str, Interval] = {}
    for field, name, value in _bound_entries(path, document):
        pair = _read_pair(path, field, value)
        link, _, kind = name.rpartition(".")
        if link in links and kind in NAMES:
            if kind in _POSITIVE and pair[1] <= 0.0:
                raise InputError(
                    f"has bounds {value!r} and nothing positive between",
                    source=path,
                    field=field,
                    remedy="masses and moments of inertia are positive",
                )
            target = parameters
        elif link in links:
            raise InputError("is unknown", source=path, field=field, remedy="choose " + ", ".join(NAMES))
        elif kind in NAMES:
            raise InputError(
                "is of no link of the robot", source=path, field=field, remedy="links are " + ", ".join(links)
            )
        else:
            target = drives
        if name in target:
            raise InputError("is bounded twice", source=path, field=field, remedy="keep one of them")
        target[name] = pair
    total = document.get("total_mass")
    return KnownBounds(
        parameters,
        drives,
        None if total is None else _read_pair(path, "total_mass", total),
        _read_rules(path, document.get("rules") or {}, links),
        str(document.get("source", path)),
    )


def _bound_entries(path: Path, document: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Place in the file, name of the parameter and its entry."""
    for link, block in _field_mapping(path, document, "links").items():
        if not isinstance(block, dict):
            raise InputError(
                f"is {block!r}", source=path, field=f"links.{link}", remedy="write {m: [lower, upper], …}"
            )
        # A name that is no parameter must not pass for a drive's.
        for name, value in block.items():
            yield f"links.{link}.{name}", f"{link}.{name}" if name in NAMES else f"{link}.", value
    for name, value in _field_mapping(path, document, "drives").items():
        yield f"drives.{name}", str(name), value
    for name, entry in _field_mapping(path, document, "parameters").items():
        yield str(name), str(name), entry.get("bounds") if isinstance(entry, dict) else entry


def _field_mapping(path: Path, document: dict[str, Any], field: str) -> dict[str, Any]:
    block = document.get(field) or {}
    if not isinstance(block, dict):
        raise InputError(f"is {block!r}", source=path, field=field, remedy="write NAME: […], a line each")
    return block


def _read_pair(path: Path, name: str, value: Any) -> Interval:
    numbers = [_read_number(entry) for entry in value] if isinstance(value, list | tuple) else []
    if len(numbers) != 2 or any(number is None for number in numbers):
        raise InputError(
            f"has bounds {value!r}", source=path, field=name, remedy="write [lower, upper], two numbers in SI"
        )
    low, high = float(numbers[0] or 0.0), float(numbers[1] or 0.0)
    if not (abs(low) <= MAX_INERTIA and abs(high) <= MAX_INERTIA):
        raise InputError(
            f"has bounds [{low:g}, {high:g}]",
            source=path,
            field=name,
            remedy=f"write numbers up to {MAX_INERTIA:g}, or leave the line out",
        )
    if not low < high:
        raise InputError(
            f"has bounds [{low:g}, {high:g}] with nothing between",
            source=path,
            field=name,
            remedy="put the lower one below the upper",
        )
    return low, high


def _read_number(value: Any) -> float | None:
    """YAML 1.1 reads ``1e-4`` as text; it is meant as a number."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and not value.isascii():
        return None
    try:
        return float(value)
    except (ValueError, OverflowError):
        return None


def _read_rules(path: Path, block: Any, links: tuple[str, ...]) -> dict[str, Any]:
    known = {"diagonal_ratio", "off_diagonal_share", "slenderness", "slender", "principal_triangle"}
    if not isinstance(block, dict):
        raise InputError(f"is {block!r}", source=path, field="rules", remedy="write " + ", ".join(known))
    for key, value in block.items():
        field = f"rules.{key}"
        if key not in known:
            raise InputError(
                "is unknown", source=path, field=field, remedy="choose " + ", ".join(sorted(known))
            )
        if key == "principal_triangle":
            if not isinstance(value, bool):
                raise InputError(f"is {value!r}", source=path, field=field, remedy="write true or false")
        elif key != "slender" and not (value is None and key != "slenderness"):
            number = _read_number(value)
            if number is None or not (math.isfinite(number) and number > 0.0):
                raise InputError(f"is {value!r}", source=path, field=field, remedy="write a positive number")
    rules = {key: _read_number(value) if isinstance(value, str) else value for key, value in block.items()}
    if "slender" in rules:
        rules["slender"] = _read_slender(path, rules["slender"] or {}, links)
    return rules


def _read_slender(path: Path, block: Any, links: tuple[str, ...]) -> dict[str, int]:
    found = {}
    for link, axis in (block if isinstance(block, dict) else {"": block}).items():
        field = f"rules.slender.{link}"
        if axis not in _AXES:
            raise InputError(f"is {axis!r}", source=path, field=field, remedy="choose x, y or z")
        if link not in links:
            raise InputError(
                "is no link of the robot", source=path, field=field, remedy="links are " + ", ".join(links)
            )
        found[link] = _AXES.index(axis)
    return found


# A file of bounds to start from: those that apply where nothing is stated, with what each line means.

_DIGITS = 4
_USUAL_DRIVES = ("viscous", "coulomb")


def write_bounds_template(robot: Robot, path: str | Path) -> Path:
    """Write the bounds that :func:`~excite.identification.physical.default_bounds.default_bounds` derives.

    Rounded outwards, so that nothing that they allow is lost; friction stands in comments.

    Args:
        robot: the robot.
        path: the file to write.

    Returns:
        The file.

    Raises:
        InputError: the file cannot be written.
    """
    path = Path(path)
    bounds = default_bounds(robot, BodySettings(com_boxes=_com_boxes_of(robot)))
    lines = [
        f"# What is known of {robot.name} before it is measured, for excite identify --bounds. Every line is",
        "# [lower, upper] and may be changed or left out; what is left out keeps the bounds written here.",
        "# Inertias are about the centre of mass, along the axes of the joint's frame.",
        f"schema: {SCHEMA}",
        f"total_mass: {_format_pair(*bounds.total_mass)}  # kg, all links; the surest one: weigh the robot",
        "links:",
    ]
    for link, low, high in zip(bounds.links, bounds.lower, bounds.upper, strict=True):
        lines += [f"  {link}:", *_link_lines(low, high)]
    lines.append("# drives:")
    for joint in robot.joint_names:
        lines += [f"#   {term}.{joint}: [0.0, 1.0]  # {DRIVE_TERMS[term].unit}" for term in _USUAL_DRIVES]
    write_text(path, "\n".join(lines) + "\n")
    return path


def _link_lines(low: Array, high: Array) -> list[str]:
    units = ["kg"] + ["m"] * 3 + ["kg·m²"] * 6
    return [
        f"    {name}: {_format_pair(float(a), float(b))}"
        + (f"  # {unit}" if name in ("m", "cx", "Ixx") else "")
        for name, a, b, unit in zip(NAMES, low, high, units, strict=True)
    ]


def _com_boxes_of(robot: Robot) -> Array:
    try:
        return com_boxes(robot)
    except RobotError:
        return equivalent_boxes(robot)


def _format_pair(low: float, high: float) -> str:
    return f"[{_round_outwards(low, math.floor)}, {_round_outwards(high, math.ceil)}]"


def _round_outwards(value: float, towards: Callable[[float], int]) -> str:
    """A few digits of a number, rounded away from the interval."""
    if value == 0.0:
        return "0.0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - _DIGITS + 1)
    return repr(float(np.format_float_positional(towards(value / step) * step, _DIGITS, fractional=False)))
