"""The robot that a motion's file names, and where its description lies."""

from __future__ import annotations

from pathlib import Path

from excite.robot.catalogue import bundled_robots
from excite.robot.description import read_description

# Whose a motion is: the robot that its file names, and where that one's description lies.


def robot_beside(file: Path, name: str) -> str:
    """What to load a motion's robot by: its name, or the description that a plan for a model of one's own kept.

    Args:
        file: the motion's file, in the plan's folder or one of its own there.
        name: of the robot, as the motion has it.
    """
    if not name or name in bundled_robots():
        return name
    for folder in file.resolve().parents[:3]:
        kept = folder / "robot" / "robot.yaml"
        if kept.is_file() and read_description(kept).name == name:
            return str(kept)
    return name
