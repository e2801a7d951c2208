"""What a text file says of itself in comments at its top."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from excite.motion.readers.reader import DAMAGED, unreadable
from excite.reading.json_document import parse_json

# Longest line of comments that is read: a verdict with some hundred violations has 30 kB.
_LONGEST_LINE = 1 << 20


def stated_in_comments(path: Path) -> dict[str, Any]:
    """The first comment that is a JSON object; empty where none is.

    Args:
        path: a text file, of which only the comments at its top are read.

    Raises:
        MotionError: a comment begins as a JSON object and is none.
    """
    try:
        with path.open("rb") as stream:
            while (line := stream.readline(_LONGEST_LINE)).startswith(b"#"):
                text = line[1:].decode().strip()
                if text.startswith("{"):
                    return dict(parse_json(text))
    except DAMAGED as error:
        raise unreadable(path, error) from error
    return {}


def of_robot(said: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of its robot, under the names of ``excite.motion/1``."""
    return {name: said[name] for name in ("robot", "robot_hash") if name in said}


def named_joints(said: Mapping[str, Any], joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that a file names; those of the robot where it names none."""
    names = said.get("joints")
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        return tuple(names)
    return tuple(joints)
