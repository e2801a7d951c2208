"""Numbers in the attributes of a MuJoCo model: finite, of a size that something has, and counts that end."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.robot.quantities import MAX_MASS
from excite.robot.urdf.numbers import shorten_text

# Gains of 1e5 and stand-ins for "no limit" of 1e6 occur; MuJoCo itself takes 1e10 for the end of all numbers.
MAX_NUMBER = 1e10
# Joints are locked by a damping of 1e11 in models that are made for learning.
MAX_DAMPING = 1e15
# Osmium has 22 600 kg/m³; a density a hundredfold is a slip of unit.
MAX_DENSITY = 1e6
# Buffers of a humanoid in a crowd have some thousands; each of these reserves memory for every one.
MAX_RESERVED = 1_000_000
# A picture or a height field of 8192 by 8192 points has 200 MB.
MAX_SIDE = 8192
MAX_MEMORY_BYTES = 4e9

# Attributes that hold words, which may look like numbers.
_WORDS = {
    "name", "class", "childclass", "model", "file", "prefix", "plugin", "instance", "key", "value",
    "joint", "joint1", "joint2", "body", "body1", "body2", "geom", "geom1", "geom2", "site", "site1", "site2",
    "mesh", "material", "texture", "hfield", "tendon", "tendon1", "tendon2", "actuator", "sensor", "target",
    "objname", "refname", "reftype", "objtype", "jointinparent", "sidesite", "refsite", "cranksite", "slidersite",
    "flex", "skin", "content_type", "dclass", "gridlayout", "quat_order", "eulerseq",
}  # fmt: skip
_SIDES = ("nrow", "ncol", "width", "height")
_MASSES = ("mass", "settotalmass", "boundmass")
_NOT_FINITE = re.compile(r"(?<![\w.])[+-]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)
_UNITS = {"": 1.0, "k": 2.0**10, "m": 2.0**20, "g": 2.0**30, "t": 2.0**40, "p": 2.0**50, "e": 2.0**60}


def check_numbers(element: ElementTree.Element, path: Path) -> None:
    """Refuse an element whose attributes hold numbers that are none, or that no model has; raises RobotError."""
    for name, text in element.items():
        if name in _WORDS:
            continue
        where = f"{element.tag}{_describe_element(element)}@{name}"
        if name == "memory":
            _check_memory(text, path, where)
        elif _NOT_FINITE.search(text):
            raise RobotError(
                f"is {shorten_text(text)!r}", source=path, field=where, remedy="give finite numbers"
            )
        else:
            _check_magnitudes(element, name, text, path, where)


def count_copies(element: ElementTree.Element, path: Path) -> int:
    """How many copies ``count_copies`` says, the product of its numbers; raises RobotError."""
    text = element.get("count", "1")
    product = 1
    for part in text.split():
        if not re.fullmatch(r"[+-]?\d+", part, re.ASCII):
            raise RobotError(
                f"is {shorten_text(text)!r}",
                source=path,
                field=f"{element.tag}@count",
                remedy="give whole numbers",
            )
        # Negative ones are MuJoCo's to refuse.
        product *= max(1, int(part)) if len(part) < 20 else 10**20
    return product


def _check_magnitudes(element: ElementTree.Element, name: str, text: str, path: Path, where: str) -> None:
    most, cause = _largest_number(element, name)
    for part in text.split():
        value = _parse_number(part)
        if value is None:
            continue
        if not part.isascii():
            remedy = "write it with the digits 0 to 9"
            raise RobotError(f"is {shorten_text(text)!r}", source=path, field=where, remedy=remedy)
        if not abs(value) <= most:
            raise RobotError(
                f"is {shorten_text(text)!r}, more than any model has ({most:g})",
                source=path,
                field=where,
                remedy=cause,
            )
        if name in ("mass", "density") and value < 0.0 and element.tag != "compiler":
            raise RobotError(f"is {part}", source=path, field=where, remedy="give a positive number")


def _largest_number(element: ElementTree.Element, name: str) -> tuple[float, str]:
    if element.tag == "size":
        return MAX_RESERVED, "reserve less"
    if name in _SIDES and element.tag in {"hfield", "texture"}:
        return MAX_SIDE, "reduce its size"
    if name in _MASSES:
        return MAX_MASS, "write kilograms"
    if name == "damping" and element.tag == "joint":
        return MAX_DAMPING, "leave the joint out, where it shall not move"
    if name == "density":
        return MAX_DENSITY, "write kg/m³"
    return MAX_NUMBER, "check its unit and exponent"


def _check_memory(text: str, path: Path, where: str) -> None:
    match = re.fullmatch(r"(-?\d+)\s*([kmgtpe]?)", text.strip().lower(), re.ASCII)
    if match is None:
        return
    if len(match[1]) > 20 or float(match[1]) * _UNITS[match[2]] > MAX_MEMORY_BYTES:
        what = f"is {shorten_text(text)!r}, more than {MAX_MEMORY_BYTES:g} bytes"
        raise RobotError(what, source=path, field=where, remedy="leave it out; MuJoCo sizes it")


def _describe_element(element: ElementTree.Element) -> str:
    name = element.get("name")
    return f" {shorten_text(name)!r}" if name else ""


def _parse_number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return math.inf if math.isnan(value) else value
