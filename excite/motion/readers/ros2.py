"""ROS 2 bags and MCAP files that hold a ``trajectory_msgs/msg/JointTrajectory``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from excite.arrays import Array
from excite.errors import MotionError
from excite.formats.bags import open_bag
from excite.formats.child import in_child
from excite.formats.documents import check_content, read_yaml
from excite.formats.file import MAX_NUMBERS, check_file, first_bytes, unreadable
from excite.motion.content import BASE_ACCELERATION, BASE_POSE, BASE_TWIST
from excite.motion.readers.reader import (
    BEGINNING,
    MAX_FILE_BYTES,
    MotionReader,
    RawMotion,
    of_robot,
    stated_in_comments,
)

JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
BASE_TRAJECTORY = "trajectory_msgs/msg/MultiDOFJointTrajectory"
CONTACTS = "/excite/contacts"
"""Topic of a JointTrajectory whose names are feet and whose positions are 1 while a foot carries load."""
ROBOT, ROBOT_HASH = "excite.robot", "excite.robot_hash"
"""Keys of the bag's custom data."""

_FIELDS = {"q": "positions", "v": "velocities", "a": "accelerations"}


class Ros2Reader(MotionReader):
    """The first joint trajectory of a bag; base and contacts from their own topics where they are there."""

    name: ClassVar[str] = "ros2"
    summary: ClassVar[str] = "ROS 2 bag folder, or an MCAP file, with a trajectory_msgs/msg/JointTrajectory"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".mcap" or (path / "metadata.yaml").is_file()

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        files = [file for file in path.iterdir() if file.suffix != ".json"] if path.is_dir() else [path]
        for file in files:
            check_file(file, limit=MAX_FILE_BYTES)
        columns, metadata = in_child("excite.motion.readers.ros2:read_bag", path, source=path, memory_gb=16.0)
        return RawMotion(columns, metadata, goal=True)


def read_bag(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Columns of a bag's trajectory and what the bag says of itself; raises MotionError."""
    columns: dict[str, NDArray[Any]] = {}
    with (
        unreadable(path, remedy="record it again"),
        open_bag(path, indexed=True) as bag,
    ):
        kinds = (JOINT_TRAJECTORY, BASE_TRAJECTORY)
        for topic, kind, message, _ in bag.messages(lambda topic, kind: kind in kinds):
            for name, values in _trajectory_columns(topic, kind, message, path).items():
                columns.setdefault(name, values)
        said = {
            key.removeprefix("excite."): str(bag.custom[key])
            for key in (ROBOT, ROBOT_HASH)
            if key in bag.custom
        }
    if "time" not in columns:
        raise MotionError(
            f"holds no {JOINT_TRAJECTORY}", source=path, remedy="give a bag with a joint trajectory"
        )
    return columns, said


def _trajectory_columns(topic: str, kind: str, message: Any, path: Path) -> dict[str, NDArray[Any]]:
    points = message.points
    if len(points) * max(len(message.joint_names), 1) > MAX_NUMBERS:
        raise MotionError(f"has {len(points)} points", source=path, remedy="check that it is a motion")
    if kind == BASE_TRAJECTORY:
        return _base_columns(points)
    if topic == CONTACTS:
        flags = _stack_rows([point.positions for point in points], message.joint_names, "positions", path)
        return {f"contact.{foot}": flags[:, i] for i, foot in enumerate(message.joint_names)}
    stamps = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points]
    columns: dict[str, NDArray[Any]] = {"time": np.array(stamps)}
    for prefix, name in _FIELDS.items():
        rows = [getattr(point, name) for point in points]
        if prefix != "q" and not any(len(row) for row in rows):
            continue
        values = _stack_rows(rows, message.joint_names, name, path)
        columns |= {f"{prefix}.{joint}": values[:, i] for i, joint in enumerate(message.joint_names)}
    return columns


def _stack_rows(rows: Sequence[Any], names: Sequence[str], what: str, path: Path) -> Array:
    for number, row in enumerate(rows):
        if len(row) != len(names):
            raise MotionError(
                f"point {number} has {len(row)} {what} for {len(names)} names",
                source=path,
                remedy="write one number a joint",
            )
    return np.array(rows, dtype=float).reshape(len(rows), len(names))


def _base_columns(points: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Pose, twist and acceleration of the base, the first of each point."""
    rows = []
    for point in points:
        pose, *rates = point.transforms[0], point.velocities[0], point.accelerations[0]
        t, r = pose.translation, pose.rotation
        vectors = [vector for rate in rates for vector in (rate.linear, rate.angular)]
        rows.append([t.x, t.y, t.z, r.x, r.y, r.z, r.w, *(x for v in vectors for x in (v.x, v.y, v.z))])
    names = (*BASE_POSE, *BASE_TWIST, *BASE_ACCELERATION)
    return dict(zip(names, np.array(rows, dtype=float).reshape(-1, len(names)).T, strict=True))


# Joint trajectories as YAML: goals of FollowJointTrajectory, and the message alone.

GOAL_FILE = "goal_{:03d}.yaml"
"""Names of several goals in a folder, by their number."""

_MARK = re.compile(rb"^(trajectory:|joint_names:)", re.MULTILINE)


class Ros2YamlReader(MotionReader):
    """``trajectory`` of a goal, or ``joint_names`` and ``points`` of a message; nothing else decides anything."""

    name: ClassVar[str] = "ros2-yaml"
    summary: ClassVar[str] = "FollowJointTrajectory goal or JointTrajectory message in YAML"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if (path / GOAL_FILE.format(0)).is_file():
            return True
        return path.suffix in {".yaml", ".yml"} and _MARK.search(first_bytes(path, BEGINNING)) is not None

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        # Three million nodes take YAML's reader half a minute and 4 GB.
        columns = in_child(
            "excite.motion.readers.ros2:read_goals",
            path,
            source=path,
            seconds=120.0,
            memory_gb=16.0,
        )
        return RawMotion(columns, of_robot(stated_in_comments(_goal_files(path)[0])), goal=True)


def _goal_files(path: Path) -> list[Path]:
    """The file, or a folder's files in their order."""
    return sorted(path.glob("goal_*.yaml")) if path.is_dir() else [path]


def read_goals(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of a goal, or of a folder of goals at the times that they state; raises MotionError."""
    parts: list[dict[str, NDArray[Any]]] = []
    for file in _goal_files(path):
        part = read_goal(file)
        start = stated_in_comments(file).get("start_s", 0.0)
        if not isinstance(start, int | float) or (parts and part.keys() != parts[0].keys()):
            raise MotionError("goes on from none of the others", source=file, remedy="export them again")
        part["time"] = part["time"] + start
        # The instant between two goals belongs to both.
        parts.append({name: values[1:] if parts else values for name, values in part.items()})
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


class _Duration(BaseModel):
    model_config = ConfigDict(strict=True)

    sec: int = 0
    nanosec: int = 0


class _Point(BaseModel):
    model_config = ConfigDict(strict=True)

    positions: list[float]
    velocities: list[float] = []
    accelerations: list[float] = []
    time_from_start: _Duration


class _Trajectory(BaseModel):
    """The message ``trajectory_msgs/msg/JointTrajectory``, as far as it is a motion."""

    model_config = ConfigDict(strict=True)

    joint_names: list[str]
    points: list[_Point] = Field(min_length=1)


def read_goal(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of a goal or message; raises MotionError that names the point at fault."""
    # A minute of a humanoid of 30 joints at 200 Hz has 1.2 million numbers, 25 MB.
    content = read_yaml(path, limit=128 * 1024 * 1024, most_nodes=3_000_000)
    remedy = "give a joint trajectory; write numbers with a point before the exponent"
    message = check_content(_Trajectory, content.get("trajectory", content), path, remedy=remedy)
    return _trajectory_columns("", JOINT_TRAJECTORY, message, path)
