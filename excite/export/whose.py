"""Whose a motion is: the robot that its file names, and where that one's description lies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from excite.motion.collection import motion_paths
from excite.motion.files import motion_robot
from excite.robot.catalogue import bundled_robots
from excite.robot.description import read_description


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


def say_their_robot(motions: Sequence[str | Path]) -> bool:
    """Whether each motion's file tells what to load its robot by, so that nobody has to name it.

    Args:
        motions: files and folders of them.
    """
    names = (robot_beside(file, motion_robot(file)) for file in motion_paths(motions))
    return all(name in bundled_robots() or (name and Path(name).is_file()) for name in names)
