"""Files of bounds of physical parameters, ``excite.physical_bounds/1``."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.errors import InputError, RobotError
from excite.formats.documents import read_yaml
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.settings import BodySettings
from excite.identification.physical.bounds import InertiaRules, Interval, KnownBounds
from excite.identification.physical.coordinates import NAMES
from excite.identification.physical.default_bounds import default_bounds
from excite.robot.quantities import MAX_INERTIA
from excite.robot.robot import Robot
from excite.robot.shapes.collision import com_boxes
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
    begin = f"start it with schema: {SCHEMA}"
    document = read_yaml(path, remedy=begin)
    if document.get("schema") != SCHEMA:
        raise InputError("is not a bounds file", source=path, field="schema", remedy=begin)
    for key in document:
        _check_among(path, str(key), key, _FIELDS)
    if not any(document.get(key) for key in _FIELDS[2:]):
        raise InputError("bounds nothing", source=path, remedy="give links, drives or total_mass")
    return document


def _check_among(
    path: Path, field: str, name: Any, known: Collection[str], what: str = "is unknown", which: str = "choose"
) -> None:
    """Refuse a name that is none of those known."""
    if name not in known:
        raise InputError(what, source=path, field=field, remedy=f"{which} {', '.join(known)}")


def _known_bounds(path: Path, document: dict[str, Any], links: tuple[str, ...]) -> KnownBounds:
    parameters: dict[str, Interval] = {}
    drives: dict[str, Interval] = {}
    for field, name, value in _bound_entries(path, document):
        pair = _read_pair(path, field, value)
        link, _, kind = name.rpartition(".")
        inside = link in links
        if inside:
            _check_among(path, field, kind, NAMES)
        elif kind in NAMES:
            _check_among(path, field, link, links, "is of no link of the robot", "links are")
        if inside and kind in _POSITIVE and pair[1] <= 0.0:
            raise InputError(
                f"has bounds {value!r} and nothing positive between",
                source=path,
                field=field,
                remedy="masses and moments of inertia are positive",
            )
        target = parameters if inside else drives
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
    for link, stated in _check_mapping(path, "links", document.get("links") or {}).items():
        block = _check_mapping(path, f"links.{link}", stated, "write {m: [lower, upper], …}")
        # A name that is no parameter must not pass for a drive's.
        for name, value in block.items():
            yield f"links.{link}.{name}", f"{link}.{name}" if name in NAMES else f"{link}.", value
    for name, value in _check_mapping(path, "drives", document.get("drives") or {}).items():
        yield f"drives.{name}", str(name), value
    for name, entry in _check_mapping(path, "parameters", document.get("parameters") or {}).items():
        yield str(name), str(name), entry.get("bounds") if isinstance(entry, dict) else entry


def _check_mapping(
    path: Path, field: str, block: Any, remedy: str = "write NAME: […], a line each"
) -> dict[str, Any]:
    """Refuse a block that is no table of names."""
    if not isinstance(block, dict):
        raise InputError(f"is {block!r}", source=path, field=field, remedy=remedy)
    return block


def _read_pair(path: Path, name: str, value: Any) -> Interval:
    numbers = [_read_number(entry) for entry in value] if isinstance(value, list | tuple) else []
    found = [number for number in numbers if number is not None]
    what, remedy = f"has bounds {value!r}", "write [lower, upper], two numbers in SI"
    if len(found) == len(numbers) == 2:
        low, high = found
        what = f"has bounds [{low:g}, {high:g}]"
        if not (abs(low) <= MAX_INERTIA and abs(high) <= MAX_INERTIA):
            remedy = f"write numbers up to {MAX_INERTIA:g}, or leave the line out"
        elif low < high:
            return low, high
        else:
            what, remedy = f"{what} with nothing between", "put the lower one below the upper"
    raise InputError(what, source=path, field=name, remedy=remedy)


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
    known = sorted(item.name for item in fields(InertiaRules))
    rules = dict(_check_mapping(path, "rules", block, f"write {', '.join(known)}"))
    for key, value in rules.items():
        field, wanted = f"rules.{key}", ""
        _check_among(path, field, key, known)
        if key == "principal_triangle":
            wanted = "" if isinstance(value, bool) else "write true or false"
        elif key != "slender" and not (value is None and key != "slenderness"):
            number = _read_number(value)
            wanted = "" if number is not None and 0.0 < number < math.inf else "write a positive number"
        if wanted:
            raise InputError(f"is {value!r}", source=path, field=field, remedy=wanted)
        rules[key] = _read_number(value) if isinstance(value, str) else value
    if "slender" in rules:
        rules["slender"] = _read_slender(path, rules["slender"] or {}, links)
    return rules


def _read_slender(path: Path, block: Any, links: tuple[str, ...]) -> dict[str, int]:
    found = {}
    for link, axis in (block if isinstance(block, dict) else {"": block}).items():
        field = f"rules.slender.{link}"
        _check_among(path, field, axis, _AXES, f"is {axis!r}")
        _check_among(path, field, link, links, "is no link of the robot", "links are")
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
