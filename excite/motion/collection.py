"""Several motions at once: files and folders, in a stable order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from excite.errors import InputError, MotionError, UnknownNameError, raised_as
from excite.formats.file import PathsLike, as_paths, unreadable_file
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.motion.readers.registry import is_motion
from excite.robot.catalogue import data_folder
from excite.robot.load import RobotLike, as_robot
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

MotionsLike = Motion | str | Path | Iterable[Motion | str | Path]
"""Motions, or files and folders of them."""


@raised_as(MotionError)
def motion_paths(paths: Iterable[str | Path]) -> list[Path]:
    """Expand folders into the motion files in them, sorted by name; ``motions/`` inside a folder counts too.

    Raises:
        MotionError: a path does not exist, or a folder holds no motion.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        try:
            folder = path.is_dir() and not is_motion(path)
            there = path.exists()
        except (OSError, ValueError) as error:
            raise unreadable_file(path, error) from error
        if not there:
            raise MotionError("no such file", source=path, remedy="check the path")
        files += _motions_inside(path) if folder else [path]
    return files


def _motions_inside(path: Path) -> list[Path]:
    """Motions in a folder, bags among them, sorted by name."""
    inside = path / "motions" if (path / "motions").is_dir() else path
    try:
        # What reports draw from, in folders of results: the suffix of a motion, and none.
        found = sorted(
            item
            for item in inside.iterdir()
            if item.name[0] != "." and item.name != "report_data.npz" and is_motion(item)
        )
    except OSError as error:
        raise unreadable_file(inside, error) from error
    if not found:
        raise MotionError(
            "folder holds no motions",
            source=path,
            remedy="expected .parquet, .csv, .npz, .mcap or ROS 2 bags",
        )
    return found


def as_motions(motions: MotionsLike, robot: Robot) -> Sequence[Motion]:
    """The motions themselves, and those in files and folders.

    Args:
        motions: motions, files, folders, mixed as they come; or one of these.
        robot: whose they are.

    Raises:
        MotionError: a file is missing or malformed, or a motion of another robot.
    """
    found: list[Motion] = []
    for item in [motions] if isinstance(motions, Motion | str | Path) else motions:
        found += [item] if isinstance(item, Motion) else load_motions([item], robot)
    return found


def load_motions(paths: PathsLike, robot: RobotLike | None = None) -> list[Motion]:
    """Read motions from files and folders, or a ready set from the motion library.

    >>> motions = load_motions("ur10")
    >>> motions[0].robot
    'ur10'

    Args:
        paths: files and folders; or, without a robot, the name of a set of the library, which is its robot's.
        robot: the robot that the motions are checked against, or its name or file.

    Returns:
        The motions, those of a folder by name.

    Raises:
        UnknownNameError: the library has no set of that name.
        MotionError: a file cannot be read, or is no motion of this robot.
        InputError: files, but no robot.
    """
    if robot is None:
        if not isinstance(paths, str) or (paths not in library_names() and Path(paths).exists()):
            raise InputError(
                "files of motions without a robot", field="robot", remedy="hand over the robot too"
            )
        folder = library_folder(paths)
        return load_motions([folder], load_robot(paths))
    loaded = as_robot(robot)
    return [load_motion(path, loaded) for path in motion_paths(as_paths(paths))]


# The motion library: ready sets of safe motions for the bundled robots.


def library_names() -> list[str]:
    """Names of the robots that the library has motions for, sorted."""
    return sorted(path.parent.name for path in data_folder("motion_library").glob("*/motions"))


def library_folder(name: str) -> Path:
    """Folder of a robot's set: ``motions/``, ``check.json``, ``conditioning.json``, ``motions.png``.

    Raises:
        UnknownNameError: the library has no set of that name.
    """
    if name not in library_names():
        raise UnknownNameError("motion set", name, library_names())
    return data_folder("motion_library") / name
