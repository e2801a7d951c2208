"""Where the robot and the log of a result lie, so that the result finds them again."""

from __future__ import annotations

import os
from pathlib import Path


def stated_origin(robot: str, log: Path, folder: Path) -> dict[str, str]:
    """Where robot and log of an identification lie, relative to its folder; nothing for a bundled robot.

    Args:
        robot: as it was given, a name or a path.
        log: the first log.
        folder: folder of the document.
    """
    if not os.path.exists(robot):
        return {}
    here = Path(folder).resolve()
    files = {"robot_file": Path(robot), "log_file": log}
    return {name: Path(os.path.relpath(file.resolve(), here)).as_posix() for name, file in files.items()}
