"""A file of bounds to start from: those that apply where nothing is stated, with what each line means."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.errors import RobotError
from excite.identification.constraints.com_box import equivalent_boxes
from excite.identification.estimators.settings import BodySettings
from excite.identification.physical.bounds_file import SCHEMA
from excite.identification.physical.coordinates import NAMES
from excite.identification.physical.default_bounds import default_bounds
from excite.robot.robot import Robot
from excite.robot.shapes.com_box import com_boxes
from excite.rows.drive_terms import DRIVE_TERMS

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
