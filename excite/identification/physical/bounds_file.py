"""Files of bounds of physical parameters, ``excite.physical_bounds/1``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import write_text
from excite.errors import InputError
from excite.formats.documents import read_yaml
from excite.identification.estimators.settings import BodySettings
from excite.identification.inertia import NAMES
from excite.identification.physical.bounds import InertiaRules, Interval, KnownBounds
from excite.identification.physical.default_bounds import default_bounds, derived_boxes
from excite.robot.quantities import MAX_INERTIA
from excite.robot.robot import Robot
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
    path, begin = Path(path), f"start it with schema: {SCHEMA}"
    document = read_yaml(path, remedy=begin)

    def refuse_unless(right: bool, field: str, what: str, remedy: str) -> None:
        if not right:
            raise InputError(what, source=path, field=field or None, remedy=remedy)

    refuse_unless(document.get("schema") == SCHEMA, "schema", "is not a bounds file", begin)
    for key in document:
        refuse_unless(key in _FIELDS, str(key), "is unknown", f"choose {', '.join(_FIELDS)}")
    some = any(document.get(key) for key in _FIELDS[2:])
    refuse_unless(some, "", "bounds nothing", "give links, drives or total_mass")
    links = tuple(segment.link for segment in robot.segments)
    parameters: dict[str, Interval] = {}
    drives: dict[str, Interval] = {}
    for field, name, value in _bound_entries(document, refuse_unless):
        pair = _read_pair(value, field, refuse_unless)
        link, _, kind = name.rpartition(".")
        inside, of_bodies = link in links, kind in NAMES
        refuse_unless(of_bodies or not inside, field, "is unknown", f"choose {', '.join(NAMES)}")
        refuse_unless(
            inside or not of_bodies, field, "is of no link of the robot", f"links are {', '.join(links)}"
        )
        empty = inside and kind in _POSITIVE and pair[1] <= 0.0
        what = f"has bounds {value!r} and nothing positive between"
        refuse_unless(not empty, field, what, "masses and moments of inertia are positive")
        target = parameters if inside else drives
        refuse_unless(name not in target, field, "is bounded twice", "keep one of them")
        target[name] = pair
    total = document.get("total_mass")
    known = KnownBounds(
        parameters,
        drives,
        None if total is None else _read_pair(total, "total_mass", refuse_unless),
        _read_rules(document.get("rules") or {}, links, refuse_unless),
        str(document.get("source", path)),
    )
    remedy = f"write TERM.JOINT with {' or '.join(DRIVE_TERMS)} and one of the joints {', '.join(robot.joint_names)}"
    for name in drives:
        term, _, joint = name.partition(".")
        right = term in DRIVE_TERMS and joint in robot.joint_names
        refuse_unless(right, name, "is no parameter of the robot", remedy)
    return known


Check = Callable[[bool, str, str, str], None]
"""Refuses what is not right: the field, what is wrong, what to do."""


def _bound_entries(document: dict[str, Any], check: Check) -> Iterator[tuple[str, str, Any]]:
    """Place in the file, name of the parameter and its entry."""
    for link, stated in _read_mapping(document.get("links"), "links", check).items():
        block = _read_mapping(stated, f"links.{link}", check, "write {m: [lower, upper], …}")
        # A name that is no parameter must not pass for a drive's.
        for name, value in block.items():
            yield f"links.{link}.{name}", f"{link}.{name}" if name in NAMES else f"{link}.", value
    for name, value in _read_mapping(document.get("drives"), "drives", check).items():
        yield f"drives.{name}", str(name), value
    for name, entry in _read_mapping(document.get("parameters"), "parameters", check).items():
        yield str(name), str(name), entry.get("bounds") if isinstance(entry, dict) else entry


def _read_mapping(
    block: Any, field: str, check: Check, remedy: str = "write NAME: […], a line each"
) -> dict[str, Any]:
    """A table of names, empty where there is none."""
    found = {} if field in _FIELDS and not block else block
    check(isinstance(found, dict), field, f"is {block!r}", remedy)
    return dict(found)


def _read_pair(value: Any, field: str, check: Check) -> Interval:
    numbers = [_read_number(entry) for entry in value] if isinstance(value, list | tuple) else []
    pair = [number for number in numbers if number is not None]
    two = len(pair) == len(numbers) == 2
    check(two, field, f"has bounds {value!r}", "write [lower, upper], two numbers in SI")
    low, high = pair
    said = f"has bounds [{low:g}, {high:g}]"
    fits = abs(low) <= MAX_INERTIA and abs(high) <= MAX_INERTIA
    check(fits, field, said, f"write numbers up to {MAX_INERTIA:g}, or leave the line out")
    check(low < high, field, f"{said} with nothing between", "put the lower one below the upper")
    return low, high


def _read_number(value: Any) -> float | None:
    """YAML 1.1 reads ``1e-4`` as text; it is meant as a number."""
    text = value if isinstance(value, str) else ""
    if isinstance(value, bool) or not isinstance(value, int | float | str) or not text.isascii():
        return None
    try:
        return float(value)
    except (ValueError, OverflowError):
        return None


def _read_rules(block: Any, links: tuple[str, ...], check: Check) -> dict[str, Any]:
    known = sorted(item.name for item in fields(InertiaRules))
    rules = _read_mapping(block, "rules", check, f"write {', '.join(known)}")
    for key, value in rules.items():
        field, number = f"rules.{key}", _read_number(value)
        check(key in known, field, "is unknown", f"choose {', '.join(known)}")
        positive = number is not None and 0.0 < number < math.inf
        right, wanted = {
            "principal_triangle": (isinstance(value, bool), "write true or false"),
            "slender": (True, ""),
            "slenderness": (positive, "write a positive number"),
        }.get(key, (positive or value is None, "write a positive number"))
        check(right, field, f"is {value!r}", wanted)
        rules[key] = number if isinstance(value, str) else value
    if "slender" in rules:
        rules["slender"] = _read_slender(rules["slender"] or {}, links, check)
    return rules


def _read_slender(block: Any, links: tuple[str, ...], check: Check) -> dict[str, int]:
    found = {}
    for link, axis in (block if isinstance(block, dict) else {"": block}).items():
        field = f"rules.slender.{link}"
        check(axis in _AXES, field, f"is {axis!r}", f"choose {', '.join(_AXES)}")
        check(link in links, field, "is no link of the robot", f"links are {', '.join(links)}")
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
    bounds = default_bounds(robot, BodySettings(com_boxes=derived_boxes(robot)[0]))
    lines = [
        f"# What is known of {robot.name} before it is measured, for excite identify --bounds. Every line is",
        "# [lower, upper] and may be changed or left out; what is left out keeps the bounds written here.",
        "# Inertias are about the centre of mass, along the axes of the joint's frame.",
        f"schema: {SCHEMA}",
        f"total_mass: {_format_pair(*bounds.total_mass)}  # kg, all links; the surest one: weigh the robot",
        "links:",
    ]
    units = {"m": "  # kg", "cx": "  # m", "Ixx": "  # kg·m²"}
    for link, *ends in zip(bounds.links, bounds.lower.tolist(), bounds.upper.tolist(), strict=True):
        pairs = zip(NAMES, *ends, strict=True)
        lines.append(f"  {link}:")
        lines += [f"    {name}: {_format_pair(*pair)}{units.get(name, '')}" for name, *pair in pairs]
    lines.append("# drives:")
    for joint in robot.joint_names:
        lines += [f"#   {term}.{joint}: [0.0, 1.0]  # {DRIVE_TERMS[term].unit}" for term in _USUAL_DRIVES]
    write_text(path, "\n".join(lines) + "\n")
    return path


def _format_pair(low: float, high: float) -> str:
    return f"[{_round_outwards(low, math.floor)}, {_round_outwards(high, math.ceil)}]"


def _round_outwards(value: float, towards: Callable[[float], int]) -> str:
    """A few digits of a number, rounded away from the interval."""
    if value == 0.0:
        return "0.0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - _DIGITS + 1)
    return repr(float(np.format_float_positional(towards(value / step) * step, _DIGITS, fractional=False)))
