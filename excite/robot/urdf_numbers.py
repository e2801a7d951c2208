"""Numbers in XML attributes, read without mercy."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError

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
) -> tuple[float, ...]:
    """The finite numbers in an attribute.

    Args:
        element: the XML element.
        attribute: its attribute.
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
    return values
