"""Several motions at once: files and folders, in a stable order."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from excite.errors import MotionError
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot

SUFFIXES = (".parquet", ".csv", ".npz")


def motion_paths(paths: Iterable[Path]) -> list[Path]:
    """Expand folders into the motion files in them, sorted by name; ``motions/`` inside a folder counts too.

    Raises:
        MotionError: a path does not exist, or a folder holds no motion.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = path / "motions" if (path / "motions").is_dir() else path
            found = sorted(
                item for item in inside.iterdir() if item.suffix in SUFFIXES and item.name[0] != "."
            )
            if not found:
                raise MotionError(
                    "folder holds no motion files", source=path, remedy=f"expected {', '.join(SUFFIXES)}"
                )
            files += found
        elif path.is_file():
            files.append(path)
        else:
            raise MotionError("no such file", source=path, remedy="check the path")
    return files


def load_motions(paths: Iterable[Path], robot: Robot) -> list[Motion]:
    """Read motions from files and folders, checked against a robot; raises MotionError."""
    return [load_motion(path, robot) for path in motion_paths(paths)]
