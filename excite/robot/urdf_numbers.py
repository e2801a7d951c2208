"""Numbers in XML attributes, read without mercy."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.robot.quantities import LIMIT, Quantity, fault

# Narrower than float(): no "nan", "inf", "1_000" or decimal commas.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def numbers(
    element: ElementTree.Element,
    attribute: str,
    count: int,
    source: Path,
    where: str,
    *,
    default: str | None = None,
    quantity: Quantity = LIMIT,
) -> tuple[float, ...]:
    """The finite numbers in an attribute.

    Args:
        element: the XML element.
        attribute: its attribute.
        count: how many numbers it must hold.
        source: file, for the error.
        where: element's path in words, for the error.
        default: text to use where the attribute is absent; None makes it compulsory.
        quantity: what they are, which bounds them.

    Raises:
        RobotError: the attribute is missing, or is not ``count`` finite decimal numbers within the bounds of
            their kind.
    """
    text = element.get(attribute, default)
    place = f"{where}@{attribute}"
    wanted = "one number" if count == 1 else f"{count} numbers separated by spaces"
    if text is None:
        raise RobotError("is missing", source=source, field=place, remedy=f"give {wanted}")
    parts = text.split()
    if len(parts) != count or not all(_NUMBER.fullmatch(part) for part in parts):
        shown = text if len(text) < 60 else text[:59] + "…"
        raise RobotError(
            f"is {shown!r}", source=source, field=place, remedy=f"give {wanted}, with a decimal point"
        )
    values = tuple(float(part) for part in parts)
    if not all(map(math.isfinite, values)):
        raise RobotError(
            f"is {text!r}, too large for a number", source=source, field=place, remedy=f"give {wanted}"
        )
    for value in values:
        what = fault(value, quantity)
        if what is not None:
            raise RobotError(what, source=source, field=place, remedy=quantity.mistake)
    return values


def single(element: ElementTree.Element, tag: str, source: Path, where: str) -> ElementTree.Element | None:
    """The child of a name, None if there is none; readers of URDFs differ in which of two they take.

    Raises:
        RobotError: there are several that say different things.
    """
    found = element.findall(tag)
    if len(found) > 1 and any(
        ElementTree.tostring(one).strip() != ElementTree.tostring(found[0]).strip() for one in found
    ):
        raise RobotError(
            f"has {len(found)} <{tag}> that differ", source=source, field=where, remedy="keep one"
        )
    return found[0] if found else None
