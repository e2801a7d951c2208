"""Joint trajectories as YAML: goals of FollowJointTrajectory, and the message alone."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import MotionError
from excite.motion.readers.reader import MotionReader, RawMotion
from excite.motion.readers.remarks import of_robot, stated_in_comments
from excite.reading.child import in_child
from excite.reading.file import first_bytes
from excite.reading.yaml_document import read_yaml

GOAL_FILE = "goal_{:03d}.yaml"
"""Names of several goals in a folder, by their number."""

_FIELDS = {"q": "positions", "v": "velocities", "a": "accelerations"}
# Comments at the top may hold a verdict of some hundred violations.
_BEGINNING = 1 << 18
_MARK = re.compile(rb"^(trajectory:|joint_names:)", re.MULTILINE)
# A minute of a humanoid of 30 joints at 200 Hz has 1.2 million numbers, 25 MB.
_MOST_BYTES, _MOST_NODES = 128 * 1024 * 1024, 3_000_000


class Ros2YamlReader(MotionReader):
    """``trajectory`` of a goal, or ``joint_names`` and ``points`` of a message; nothing else decides anything."""

    name: ClassVar[str] = "ros2-yaml"
    summary: ClassVar[str] = "FollowJointTrajectory goal or JointTrajectory message in YAML"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if (path / GOAL_FILE.format(0)).is_file():
            return True
        return path.suffix in {".yaml", ".yml"} and _MARK.search(first_bytes(path, _BEGINNING)) is not None

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        # Three million nodes take YAML's reader half a minute and 4 GB.
        columns = in_child(
            "excite.motion.readers.ros2_yaml:read_goals",
            path,
            source=path,
            error=MotionError,
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


def read_goal(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of a goal or message; raises MotionError that names the point at fault."""
    content = read_yaml(path, error=MotionError, limit=_MOST_BYTES, most_nodes=_MOST_NODES)
    trajectory = content.get("trajectory", content)
    names = trajectory.get("joint_names") if isinstance(trajectory, Mapping) else None
    points = trajectory.get("points") if isinstance(trajectory, Mapping) else None
    if not isinstance(names, list) or not isinstance(points, list) or not points:
        raise MotionError(
            "has no joint_names and points", source=path, field="trajectory", remedy="give a joint trajectory"
        )
    if not all(isinstance(point, Mapping) for point in points):
        raise MotionError("holds a point that is no mapping", source=path, remedy="name its fields")
    columns: dict[str, NDArray[Any]] = {
        "time": np.array([_point_time(k, p, path) for k, p in enumerate(points)])
    }
    for prefix, field in _FIELDS.items():
        if prefix != "q" and not any(point.get(field) for point in points):
            continue
        rows = np.array([_point_row(k, point, field, len(names), path) for k, point in enumerate(points)])
        columns |= {f"{prefix}.{joint}": rows[:, i] for i, joint in enumerate(names)}
    return columns


def _point_time(number: int, point: Mapping[str, Any], path: Path) -> float:
    stamp = point.get("time_from_start")
    parts = [stamp.get(name, 0) for name in ("sec", "nanosec")] if isinstance(stamp, Mapping) else []
    if not parts or not all(isinstance(part, int) for part in parts):
        raise MotionError(
            f"of point {number} is no sec and nanosec",
            source=path,
            field="time_from_start",
            remedy="write {sec: 0, nanosec: 0}",
        )
    return float(parts[0]) + 1e-9 * float(parts[1])


def _point_row(number: int, point: Mapping[str, Any], field: str, width: int, path: Path) -> list[float]:
    row = point.get(field)
    if not isinstance(row, list) or len(row) != width:
        found = len(row) if isinstance(row, list) else "no"
        raise MotionError(
            f"point {number} has {found} {field} for {width} names",
            source=path,
            remedy="write one number a joint",
        )
    for value in row:
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise MotionError(
                f"of point {number} holds {str(value)[:40]!r}",
                source=path,
                field=field,
                remedy="write numbers, with a point before the exponent",
            )
    return [float(value) for value in row]
