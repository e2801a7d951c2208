"""A robot from whatever a user names: a bundled name, a ``robot.yaml``, a model, a package of MoveIt."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from functools import cache
from hashlib import sha256
from pathlib import Path

from excite.atomic import all_or_nothing, write_bytes, write_text
from excite.errors import InputError
from excite.robot.catalogue import MODEL_SUFFIXES, bundled_robots
from excite.robot.init_robot.packages import find_model
from excite.robot.init_robot.source import Source, model_source
from excite.robot.loading import limited_description
from excite.robot.loading import load_robot as load_described
from excite.robot.robot import Robot
from excite.temporary_folder import TemporaryFolder, in_temporary_folder

# A robot from whatever a person brings: a bundled name, a ``robot.yaml``, or a bare URDF, xacro or MuJoCo
# model.

RobotLike = Robot | str | Path
"""A robot, or what :func:`load_robot` makes one of."""


def load_robot(name_or_path: str | Path, source: Source | None = None) -> Robot:
    """Load a robot by bundled name, from a ``robot.yaml``, or from a bare model with a first description.

    Args:
        name_or_path: bundled name (``excite robots`` lists them), folder, or path of a ``robot.yaml``, URDF, xacro,
            MJCF, SDF or USD, or a package of MoveIt. What a bare model does not say is assumed, and stands in
            ``robot.description.assumed``; that first description lasts as long as the process, where
            :func:`keep_description` does not copy it.
        source: how a bare model is to be read, and the file of joint limits that holds for any robot where it is
            tighter than what that states.

    Returns:
        The robot, everything in it checked.

    Raises:
        RobotError: a file is missing or malformed, or a number in it is absurd.
        UnknownNameError: neither a file nor a bundled robot.
    """
    path, source = find_model(name_or_path, source or model_source())
    described = None if path.suffix in MODEL_SUFFIXES else load_described(path)
    if described is not None and source.limits is None:
        return described
    # A model's path tells it from others of its name, and may be longer than a name of a folder.
    folder = _temporary_folder().path / sha256(f"{os.path.realpath(path)}{source}".encode()).hexdigest()
    if described is not None and source.limits is not None:
        text = limited_description(described, source.limits)
        return load_described(write_text(folder / "robot.yaml", text))
    from excite.robot.init_robot.files import write_scaffold  # lazy: scipy

    written = write_scaffold(path, folder, overwrite=True, source=source, absolute=True)
    return load_described(written.description)


def keep_description(robot: Robot, results: Path) -> Robot:
    """The robot, its description in a folder of results where it would else go with the process.

    Args:
        results: the folder; the first description of a bare model goes to ``robot`` in it, with all that it names.
    """
    if not in_temporary_folder(robot.source):
        return robot
    written, there = robot.source.parent, results / "robot"
    with all_or_nothing():
        for file in sorted(path for path in written.rglob("*") if path.is_file()):
            write_bytes(there / file.relative_to(written), file.read_bytes())
    return replace(robot, source=there / robot.source.name)


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
def _temporary_folder() -> TemporaryFolder:
    return TemporaryFolder()


# What there is to say about each bundled robot in a line.


@dataclass(frozen=True)
class RobotSummary:
    """A robot in a line.

    Attributes:
        name: bundled name.
        title: what it is.
        base: ``fixed`` or ``floating``.
        n_joints: actuated joints, the degrees of freedom beside the base.
        mass: total mass of the moving segments [kg].
        sensors: what it measures beside joint angles: names of wrench sensors with their kind, or where
            joint torque is measured.
        rate_hz: sampling rate of the sensors [Hz].
    """

    name: str
    title: str
    base: str
    n_joints: int
    mass: float
    sensors: tuple[str, ...]
    rate_hz: float

    def to_json(self) -> dict[str, object]:
        """The fields by name, ready for JSON."""
        return {**asdict(self), "sensors": list(self.sensors)}


def summarise_robot(robot: Robot) -> RobotSummary:
    """Summary of one robot."""
    said, sensors = robot.description, [f"{sensor.name} ({sensor.kind})" for sensor in robot.sensors]
    torque = said.sensors.joint_torque
    sensors += [] if torque is None else [f"joint torque ({torque})"]
    mass, rate = round(robot.mass, 3), said.sensors.rate_hz
    return RobotSummary(robot.name, said.title, said.base, robot.n_joints, mass, tuple(sensors), rate)


def robot_summaries() -> tuple[RobotSummary, ...]:
    """Summaries of all bundled robots, by name; raises RobotError if one of them is broken."""
    return tuple(summarise_robot(load_described(name)) for name in bundled_robots())
