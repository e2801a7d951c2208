"""Where bundled robots and their files are found, from a checkout or from an installed wheel."""

from __future__ import annotations

import os
import sysconfig
from pathlib import Path

import excite
from excite.errors import UnknownNameError
from excite.robot.refusal import robot_error

# What an SDF is, its reader says.
MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf", ".xacro", ".sdf", ".usd", ".usda", ".usdc", ".usdz")
_PACKAGE = Path(excite.__file__).resolve().parent


def data_folder(kind: str) -> Path:
    """Folder of bundled data: ``robots`` or ``motion_library``.

    In an installed wheel it lies inside the package, in a checkout beside it.
    """
    inside = _PACKAGE / "data" / kind
    return inside if inside.is_dir() else _PACKAGE.parent / kind


def bundled_robots() -> list[str]:
    """Names of the bundled robots, sorted."""
    return sorted(path.parent.name for path in data_folder("robots").glob("*/robot.yaml"))


def robot_of_log(name: str, file: str, log: Path) -> str | Path:
    """The robot of a log as a command names it: a bundled name, else the file that the log brings.

    Args:
        file: the nominal model's, relative to the log.
        log: the log's folder, or its ``log.yaml``.
    """
    if name in bundled_robots():
        return name
    return (log if log.is_dir() else log.parent) / file


def is_robot(name_or_path: str | Path) -> bool:
    """Whether a name or path is of a robot rather than of a log: by its ending, by what lies there, or bundled."""
    path = Path(name_or_path)
    if path.suffix in MODEL_SUFFIXES:
        return True
    if path.suffix in {".yaml", ".yml"}:
        return path.name not in {"log.yaml", "log.yml"}
    if os.path.isfile(path / "log.yaml"):
        return False
    return (
        is_package(path)
        or os.path.isfile(path / "robot.yaml")
        or (not os.path.lexists(path) and str(name_or_path) in bundled_robots())
    )


def is_package(path: Path) -> bool:
    """Whether a folder is a package of ROS or MoveIt without a ``robot.yaml``."""
    return not os.path.isfile(path / "robot.yaml") and any(
        os.path.isfile(path / name) for name in ("package.xml", ".setup_assistant")
    )


def find_robot(name_or_path: str | Path) -> Path:
    """Path of the ``robot.yaml`` for a bundled name, a folder or a file.

    Raises:
        UnknownNameError: neither a file nor a bundled robot.
        RobotError: a file of another kind, or a folder without one.
    """
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml", *MODEL_SUFFIXES}:
        return path
    bundled = data_folder("robots") / str(name_or_path) / "robot.yaml"
    if os.path.isfile(bundled):
        return bundled
    if os.path.isfile(path / "robot.yaml"):
        return path / "robot.yaml"
    if os.path.isfile(path):
        raise robot_error(
            path,
            None,
            "is neither a robot.yaml nor a URDF, xacro or MJCF by its name",
            "let its name end in what it is, or convert it to URDF or MJCF",
        )
    if str(name_or_path) and os.path.isdir(path):
        remedy = "name the URDF, xacro or MJCF, or the robot.yaml that excite init-robot makes of it"
        raise robot_error(path, None, "is a folder without a robot.yaml", remedy)
    raise UnknownNameError("robot", str(name_or_path), [*bundled_robots(), "a path to a robot.yaml"])


def example_robot_data() -> Path:
    """Folder of the robots in the ``example-robot-data`` wheel.

    Raises:
        RobotError: the wheel is not installed.
    """
    relative = Path("cmeel.prefix/share/example-robot-data/robots")
    for scheme in ("purelib", "platlib"):
        folder = Path(sysconfig.get_paths()[scheme]) / relative
        if folder.is_dir():
            return folder
    raise robot_error(relative, None, "robot data not found", "pip install example-robot-data==6.0.0")
