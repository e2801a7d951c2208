"""Pairs of links that an SRDF file lets touch."""

from __future__ import annotations

from pathlib import Path

from excite.errors import RobotError
from excite.reading.xml_document import read_xml


def read_srdf(path: Path) -> tuple[tuple[str, str], ...]:
    """Pairs that ``disable_collisions`` names.

    Raises:
        RobotError: the file is missing, is no SRDF, or a pair names one link only.
    """
    root = read_xml(path, error=RobotError)
    if root.tag != "robot" or root.find("link") is not None:
        raise RobotError(
            "is no SRDF", source=path, field=root.tag, remedy="give the .srdf of a MoveIt configuration"
        )
    pairs = []
    for number, element in enumerate(root.findall("disable_collisions")):
        first, second = element.get("link1"), element.get("link2")
        if not first or not second:
            raise RobotError(
                "names one link only",
                source=path,
                field=f"disable_collisions {number}",
                remedy="give link1 and link2",
            )
        pairs.append((first, second))
    return tuple(pairs)
