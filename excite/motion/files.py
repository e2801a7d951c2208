"""Motion files, ``excite.motion/1``: Parquet, CSV or npz with the same column names; and motions made elsewhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow.csv
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from excite.arrays import Array
from excite.arrow_columns import arrow_table
from excite.atomic import atomic_path
from excite.errors import MotionError
from excite.motion.columns import check_joints, check_time, numeric_columns, stack_columns
from excite.motion.content import (
    BASE_ACCELERATION,
    BASE_POSE,
    BASE_TWIST,
    content_hash,
    motion_columns,
    unit_quaternions,
)
from excite.motion.derivatives import with_derivatives
from excite.motion.motion import Motion, MotionMetadata
from excite.motion.parquet import narrow_columns, write_parquet
from excite.motion.readers.npz import METADATA
from excite.motion.readers.registry import read_motion
from excite.motion.setpoints import sampled_curve, stated_curve
from excite.reading.json_document import check_content
from excite.robot.bringing import RobotLike, as_robot
from excite.robot.robot import Robot

SCHEMA = "excite.motion/1"
_Name = Annotated[str, Field(max_length=1000)]


class MotionDocument(BaseModel):
    """What a motion's file says of itself."""

    model_config = ConfigDict(extra="allow", frozen=True)

    schema_: Literal["excite.motion/1"] = Field(alias="schema")
    robot: _Name = ""
    robot_hash: _Name = ""
    generator: _Name = "unknown"
    seed: int | None = None
    targets: tuple[_Name, ...] = ()
    versions: dict[str, _Name] = {}
    previous: _Name = ""
    following: _Name = Field(default="", alias="next")
    content_hash: _Name = ""
    verdict: dict[str, Any] | None = None


def save_motion(motion: Motion, path: Path, *, single: bool = False) -> Path:
    """Write a motion; the format follows the suffix (``.parquet``, ``.csv``, ``.npz``).

    The file states the hash of its samples, and the motion's verdict if that belongs to them as they are written. It
    appears under its name only when it is complete.

    Args:
        motion: the motion.
        path: where to.
        single: in Parquet, positions in single precision, velocities and accelerations to 16 binary digits: a
            third of the size.

    Returns:
        The file.

    Raises:
        MotionError: unknown suffix.
        InputError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in {".parquet", ".csv", ".npz"}:
        raise MotionError(f"unknown format {path.suffix!r}", source=path, remedy="use .parquet, .csv or .npz")
    columns: dict[str, NDArray[Any]] = motion_columns(motion)
    if single and path.suffix == ".parquet":
        columns = narrow_columns(columns)
    metadata = json.dumps(_motion_document(motion, content_hash(columns)))
    with atomic_path(path) as temporary:
        if path.suffix == ".npz":
            np.savez_compressed(temporary, allow_pickle=False, **{METADATA: metadata}, **columns)
        elif path.suffix == ".csv":
            with temporary.open("wb") as stream:
                stream.write(f"# {metadata}\n".encode())
                pyarrow.csv.write_csv(arrow_table(columns), stream)
        else:
            write_parquet(columns, metadata, temporary, single=single)
    return path


def _motion_document(motion: Motion, digest: str) -> dict[str, Any]:
    metadata = motion.metadata
    verdict = metadata.verdict
    return {
        "schema": SCHEMA,
        "robot": motion.robot,
        "robot_hash": metadata.robot_hash,
        "generator": metadata.generator,
        "seed": metadata.seed,
        "targets": list(metadata.targets),
        "versions": dict(metadata.versions),
        "previous": metadata.previous,
        "next": metadata.following,
        "content_hash": digest,
        "verdict": dict(verdict) if verdict is not None and verdict.get("content_hash") == digest else None,
    }


def load_motion(path: str | Path, robot: RobotLike) -> Motion:
    """Read a motion of a robot, from a file of ``excite.motion/1`` or of a format that somebody else wrote.

    Every command reads motions here (:data:`~excite.motion.readers.registry.READERS`). Joints may stand in any order;
    those that no motor drives may be left out, and are then where the others hold them. Velocities and accelerations
    that are not there are those of a cubic spline through what is.

    Args:
        path: a file, or the folder of a ROS 2 bag.
        robot: the robot that it is for, or its name or file.

    Returns:
        The motion.

    Raises:
        OtherRobotError: it names another robot, and joints that this one lacks.
        MotionError: unreadable, wrong schema, missing columns, NaN, a column with too many axes, unsorted time, joints
            that the robot lacks, a mechanism that cannot be closed.
    """
    path, robot = Path(path), as_robot(robot)
    raw = read_motion(path, robot.joint_names)
    said = _read_statement(raw.metadata, path)
    columns = numeric_columns(raw.columns, path)
    joints = _joints_in(columns, robot)
    check_joints(columns, robot, path, "" if said is None else said.robot)
    check_time(columns, path)
    digest = content_hash(columns) if said is not None and said.content_hash else ""
    curve = stated_curve(list(columns), columns["time"], goal=raw.goal, floating=robot.floating)
    stack_columns(columns, [f"q.{joint}" for joint in joints], path)
    columns = sampled_curve(columns, joints, curve, path)
    columns = with_derivatives(columns, joints, path)
    q, v, a = (stack_columns(columns, [f"{p}.{joint}" for joint in joints], path) for p in ("q", "v", "a"))
    contacts = {}
    if joints != robot.joint_names:
        q, v, a = (_among_all(robot, values) for values in (q, v, a))
    if robot.floating:
        pose = stack_columns(columns, BASE_POSE, path)
        norm = np.linalg.norm(pose[:, 3:], axis=1)
        if (np.abs(norm - 1.0) > 1e-3).any():
            raise MotionError(
                f"quaternion of norm {norm[int(np.argmax(np.abs(norm - 1.0)))]:.4f}",
                source=path,
                field="base.qw",
                remedy="write unit quaternions, x y z w",
            )
        pose[:, 3:] = unit_quaternions(pose[:, 3:])
        q = np.hstack([pose, q])
        v = np.hstack([stack_columns(columns, BASE_TWIST, path), v])
        a = np.hstack([stack_columns(columns, BASE_ACCELERATION, path), a])
        flags = {foot.name: f"contact.{foot.name}" for foot in robot.feet}
        # A foot without flags is no error of the file's: the check says so, and that the motion is not safe.
        contacts = {foot: columns[name] > 0.5 for foot, name in flags.items() if name in columns}
    if joints != robot.joint_names and robot.mechanism is not None:
        q, v, a = robot.mechanism.completed(q, v, a)
    return Motion(
        name=path.stem,
        robot=(said.robot if said is not None else "") or robot.name,
        joint_names=robot.joint_names,
        time=columns["time"],
        q=q,
        v=v,
        a=a,
        contacts=contacts,
        metadata=_motion_metadata(said, digest),
        curve=curve if curve == "spline" else "quintic",
    )


def _joints_in(columns: Mapping[str, Array], robot: Robot) -> tuple[str, ...]:
    """The joints that a file has to have: all, or those with a motor where it says nothing of any other."""
    follow = [name for name in robot.joint_names if name not in robot.driven_names]
    alone = follow and not any(f"q.{name}" in columns for name in follow)
    return robot.driven_names if alone else robot.joint_names


def _among_all(robot: Robot, driven: Array) -> Array:
    """Columns of joints with a motor among those of all joints, others zero."""
    values = np.zeros((len(driven), robot.n_joints))
    values[:, ~robot.passive] = driven
    return values


def motion_robot(path: Path) -> str:
    """Name of the robot that a motion file says it is for, empty where it says nothing; raises MotionError."""
    said = _read_statement(read_motion(Path(path)).metadata, Path(path))
    return "" if said is None else said.robot


def _read_statement(metadata: Any, path: Path) -> MotionDocument | None:
    """What a file says of itself; None for one that was made elsewhere."""
    if metadata == {}:
        return None
    if not isinstance(metadata, Mapping):
        raise MotionError(
            "is no JSON object", source=path, field="metadata", remedy="write it with save_motion"
        )
    if set(metadata) <= {"robot", "robot_hash"}:
        metadata = {"schema": SCHEMA, **metadata}
    if metadata.get("schema") != SCHEMA:
        found = metadata.get("schema")
        raise MotionError(
            f"states no schema, as a motion of {SCHEMA!r} does"
            if found is None
            else f"schema is {repr(found)[:60]}, not {SCHEMA!r}",
            source=path,
            field="schema",
            remedy="check that it is a motion; write one with excite.save_motion, or a table without metadata",
        )
    return check_content(
        MotionDocument, dict(metadata), path, remedy="check that it is a motion", error=MotionError
    )


def _motion_metadata(said: MotionDocument | None, digest: str) -> MotionMetadata:
    if said is None:
        return MotionMetadata(generator="elsewhere")
    return MotionMetadata(
        generator=said.generator,
        seed=said.seed,
        targets=said.targets,
        robot_hash=said.robot_hash,
        versions=said.versions,
        previous=said.previous,
        following=said.following,
        verdict=said.verdict,
        stated_hash="" if said.content_hash == digest else said.content_hash,
    )
