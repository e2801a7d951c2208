"""A robot from whatever a person brings: a bundled name, a ``robot.yaml``, or a bare URDF, xacro or MuJoCo model."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from excite.errors import InputError
from excite.robot.catalogue import find_robot
from excite.robot.loading import load_robot as load_described
from excite.robot.robot import Robot
from excite.temporary_folder import TemporaryFolder

RobotLike = Robot | str | Path
"""A robot, or what :func:`load_robot` makes one of."""

_MODELS = (".urdf", ".xml", ".mjcf", ".xacro")


def load_robot(name_or_path: str | Path, *, keep: str | Path | None = None) -> Robot:
    """Load a robot by bundled name, from a ``robot.yaml``, or from a bare model with a first description.

    Args:
        name_or_path: bundled name (``excite robots`` lists them), folder, or path of a ``robot.yaml``, URDF, xacro
            or MJCF. What a bare model does not say is assumed, and stands in ``robot.description.assumed``.
        keep: folder in which the first description of a bare model is kept; else it lasts as long as the process.

    Returns:
        The robot, everything in it checked.

    Raises:
        RobotError: a file is missing or malformed, or a number in it is absurd.
        UnknownNameError: neither a file nor a bundled robot.
    """
    path = Path(name_or_path) if Path(name_or_path).suffix in _MODELS else find_robot(name_or_path)
    if path.suffix not in _MODELS:
        return load_described(path)
    from excite.robot.scaffold.files import write_scaffold  # lazy: scipy

    folder = (
        Path(keep) if keep is not None else _temporary().path / path.resolve().as_posix().replace("/", "_")
    )
    return load_described(write_scaffold(path, folder, overwrite=True, absolute=True).description)


def as_robot(robot: RobotLike) -> Robot:
    """The robot itself, or the one of that name or file.

    Raises:
        InputError: it is neither.
        RobotError: a file is missing or malformed.
        UnknownNameError: neither a file nor a bundled robot.
    """
    if isinstance(robot, Robot):
        return robot
    if isinstance(robot, str | Path):
        return load_robot(robot)
    raise InputError(
        f"is a {type(robot).__name__}", source="robot", remedy="give a Robot, a bundled name or a file"
    )


@cache
def _temporary() -> TemporaryFolder:
    return TemporaryFolder()
