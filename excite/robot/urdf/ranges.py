"""Ranges that a URDF states of joints that it calls ``continuous``."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

from excite.robot.urdf.numbers import numbers

# Wider than this is a whole turn, as no range is written: ±3.14 is one less 0.05 % [rad].
_TURN = 0.99 * 2.0 * math.pi


def stated_ranges(root: ElementTree.Element, path: Path) -> dict[str, tuple[float, float]]:
    """Ranges by joint of those that are ``continuous`` and yet state one of less than a turn [rad].

    The format has no limits for such joints and readers ignore them, but Cassie's and Digit's state where their knees
    end. Equal limits, such as exporters' zeros, and those of a turn or more are none.

    Args:
        root: the ``robot`` element.
        path: its file, for the error.

    Raises:
        RobotError: a limit is no finite number.
    """
    found = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") != "continuous" or limit is None or not {"lower", "upper"} <= set(limit.attrib):
            continue
        where = f"joint {joint.get('name')!r}/limit"
        lower, upper = (numbers(limit, side, 1, path, where)[0] for side in ("lower", "upper"))
        if 0.0 < upper - lower < _TURN:
            found[joint.get("name", "")] = (lower, upper)
    return found


def keep_stated_ranges(root: ElementTree.Element, path: Path) -> None:
    """Make those joints revolute, so that every reader keeps them within; errors as for :func:`stated_ranges`."""
    ranged = stated_ranges(root, path)
    for joint in root.findall("joint"):
        if joint.get("name") in ranged:
            joint.set("type", "revolute")
