"""What a text file says of itself in comments at its top."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from excite.motion.readers.reader import DAMAGED, unreadable
from excite.reading.json_document import parse_json

# Longest line of comments that is read: a verdict with some hundred violations has 30 kB.
_LONGEST_LINE = 1 << 20


def stated_in_comments(path: Path, mark: str = "#") -> dict[str, Any]:
    """``robot``, ``robot_hash`` and ``joints`` of the first comment that is a JSON object; empty without one.

    Args:
        path: a text file, of which only the comments at its top are read.
        mark: how a comment's line begins.

    Raises:
        MotionError: a comment begins as a JSON object and is none.
    """
    try:
        with path.open("rb") as stream:
            while (line := stream.readline(_LONGEST_LINE)).startswith(mark.encode()):
                text = line[len(mark) :].decode().strip()
                if text.startswith("{"):
                    said = parse_json(text)
                    return {name: said[name] for name in ("robot", "robot_hash", "joints") if name in said}
    except DAMAGED as error:
        raise unreadable(path, error) from error
    return {}


def named_joints(said: dict[str, Any], joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that a file names, taken out of ``said``; those of the robot where it names none."""
    names = said.pop("joints", None)
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        return tuple(names)
    return tuple(joints)
