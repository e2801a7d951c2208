"""Numbers in XML attributes, read without mercy."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.robot.quantities import (
    MAX_FORCE,
    MAX_INERTIA,
    MAX_LENGTH,
    MAX_MASS,
    MAX_ORIENTATION,
    MAX_STAND_IN,
    MAX_TRAVEL,
)
from excite.robot.refusal import robot_error
from excite.robot.urdf.writing import MOMENTS

# Largest magnitude by attribute, and the likely cause of a larger one; elsewhere what stands in for "no limit".
_LARGEST: dict[str, tuple[float, str]] = {
    "xyz": (MAX_TRAVEL, "looks like millimetres: write metres"),
    "rpy": (MAX_ORIENTATION, "looks like degrees: write radians"),
    "value": (MAX_MASS, "write kilograms"),
    "effort": (MAX_FORCE, "write N·m or N"),
    # A first description reads much smaller ones as no limit.
    "velocity": (MAX_STAND_IN, "write rad/s or m/s"),
    "size": (MAX_LENGTH, "write metres"),
    "radius": (MAX_LENGTH, "write metres"),
    "length": (MAX_LENGTH, "write metres"),
    **dict.fromkeys(MOMENTS, (MAX_INERTIA, "write kg·m²")),
}

# Narrower than float(): no "nan", "inf", "1_000" or decimal commas.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def read_numbers(
    element: Element,
    attribute: str,
    count: int,
    source: Path,
    where: str,
    *,
    default: str | None = None,
) -> tuple[float, ...]:
    """The finite numbers in an attribute.

    Args:
        count: how many numbers it must hold.
        source: file, for the error.
        where: element's path in words, for the error.
        default: text to use where the attribute is absent; None makes it compulsory.

    Raises:
        RobotError: the attribute is missing, or is not ``count`` finite decimal numbers.
    """
    text = element.get(attribute, default)
    place = f"{where}@{attribute}"
    wanted = "one number" if count == 1 else f"{count} numbers separated by spaces"
    if text is None:
        raise robot_error(source, place, "is missing", f"give {wanted}")
    parts, said = text.split(), f"is {shorten_text(text)!r}"
    # str.split() also takes spaces that readers written in C do not know.
    if not text.isascii() or len(parts) != count or not all(_NUMBER.fullmatch(part) for part in parts):
        raise robot_error(source, place, said, f"give {wanted}, with a decimal point")
    values = tuple(float(part) for part in parts)
    most, cause = _LARGEST.get(attribute, (MAX_STAND_IN, "check its unit and exponent"))
    if not all(map(math.isfinite, values)):
        raise robot_error(source, place, f"{said}, too large for a number", f"give {wanted}")
    if max(map(abs, values)) > most:
        raise robot_error(source, place, f"{said}, more than any robot has ({most:.4g})", cause)
    return values


def read_number(
    element: Element, attribute: str, source: Path, where: str, *, default: str | None = None
) -> float:
    """The one finite number in an attribute; arguments and errors as for :func:`read_numbers`."""
    return read_numbers(element, attribute, 1, source, where, default=default)[0]


def read_origin(element: Element, source: Path = Path(), where: str = "") -> pin.SE3:
    """The pose that the ``<origin>`` below an element states, none where it has none; raises RobotError."""
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (
        np.array(read_numbers(origin, key, 3, source, f"{where}/origin", default="0 0 0"))
        for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def shorten_text(text: str) -> str:
    """A text that fits into a line."""
    return text if len(text) < 60 else text[:59] + "…"
