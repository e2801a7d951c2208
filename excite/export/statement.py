"""What a file says of itself: whose motion it is, and what the independent check said of it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from excite.motion.motion import Motion
from excite.motion.readers.table import UNSAFE
from excite.safety.verdict import Violation, conditions


def motion_statement(motion: Motion) -> dict[str, Any]:
    """``robot``, ``robot_hash``, ``joints`` in their order and ``verdict`` of a motion that was cleared."""
    metadata = motion.metadata
    return {
        "robot": motion.robot,
        "robot_hash": metadata.robot_hash,
        "joints": list(motion.joint_names),
        "verdict": metadata.verdict,
    }


def motion_warnings(motion: Motion) -> list[str]:
    """What whoever opens the file has to know, one line each; nothing of a motion that is safe."""
    verdict = motion.metadata.verdict or {}
    if "unsafe_anyway" not in verdict:
        return []
    said = [str(Violation(**item)) for item in verdict["violations"]]
    lines = [f"written all the same, {verdict['unsafe_anyway']}", *said]
    return [f"{UNSAFE}: {' '.join(line.split())}" for line in lines]


def motion_remarks(motion: Motion) -> list[str]:
    """Lines for a person who opens the file: warnings, whose motion it is, and the smallest margins."""
    verdict = motion.metadata.verdict or {}
    lines = [
        *motion_warnings(motion),
        f"motion {motion.name} of robot {motion.robot}, {motion.duration:.3f} s",
    ]
    if verdict.get("safe"):
        margins = {name: value for name, value in verdict["margins"].items() if value is not None}
        stated = ", ".join(f"{name} {value:.4g}" for name, value in margins.items())
        held = conditions(verdict.get("as_far_as", ()))
        lines.append(f"found safe by the independent check{held}; smallest margins: {stated}")
    return [" ".join(line.split()) for line in lines]


def comment_lines(motion: Motion) -> str:
    """Comment lines for a text file: the remarks, and the statement as one line of JSON that is read again."""
    return as_comments([*motion_remarks(motion), json.dumps(motion_statement(motion))])


def as_comments(lines: Iterable[str]) -> str:
    """Lines as comments."""
    return "".join(f"# {line}\n" for line in lines)
