"""Where the robot and the log of a result lie, so that the result finds them again."""

from __future__ import annotations

import os
from pathlib import Path


def stated_origin(robot: str, log: Path | None, folder: Path) -> dict[str, str]:
    """Where robot and log of a result lie, relative to its folder; of a bundled robot, or the log's own, only the log.

    Args:
        robot: as it was given, a name or a path; empty where it was not.
        log: the first log; None where there is none.
        folder: folder of the document.
    """
    files = {"robot_file": Path(robot)} if os.path.exists(robot) else {}
    if log is not None:
        files["log_file"] = Path(log)
    return {name: relative_to(folder, file) for name, file in files.items()}


def relative_to(folder: Path, file: Path) -> str:
    """A file as a document in a folder names it."""
    return Path(os.path.relpath(Path(file).resolve(), Path(folder).resolve())).as_posix()
