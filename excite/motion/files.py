"""Motion files, ``excite.motion/1``: Parquet, CSV or npz with the same column names; and motions made elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import MotionError, OtherRobotError, raised_as
from excite.formats.documents import check_content
from excite.formats.registry import format_of
from excite.motion.content import (
    BASE_ACCELERATION,
    BASE_POSE,
    BASE_TWIST,
    content_hash,
    motion_columns,
    unit_quaternions,
)
from excite.motion.motion import Motion, MotionMetadata
from excite.motion.readers.registry import read_motion
from excite.motion.setpoints import Curve, StatedCurve, sampled_curve, stated_curve
from excite.robot.load import RobotLike, as_robot
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
    curve: StatedCurve | None = None
    blend_s: float | None = None
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
        columns = {name: _narrow_column(name, column) for name, column in columns.items()}
    metadata = json.dumps(_motion_document(motion, content_hash(columns)))
    with atomic_path(path) as temporary:
        format_of(path).write(columns, temporary, metadata)
    return path


# What a motion knows of itself and its file says: under the same names but for ``following``, which is ``next`` there.
_STATED = ("robot_hash", "generator", "seed", "targets", "versions", "previous", "following")


def _motion_document(motion: Motion, digest: str) -> dict[str, Any]:
    metadata = motion.metadata
    verdict = metadata.verdict
    return {
        "schema": SCHEMA,
        "robot": motion.robot,
        **{{"following": "next"}.get(name, name): getattr(metadata, name) for name in _STATED},
        "content_hash": digest,
        "verdict": verdict if verdict is not None and verdict.get("content_hash") == digest else None,
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
    told = None if said is None else said.curve
    curve: Curve | None = told
    if curve is None:
        curve = stated_curve(list(columns), columns["time"], goal=raw.goal, floating=robot.floating)
    elif robot.floating:
        raise MotionError(
            f"states the curve {curve!r}, which no controller runs with a free base",
            source=path,
            field="curve",
            remedy="leave it out",
        )
    stack_columns(columns, [f"q.{joint}" for joint in joints], path)
    columns = sampled_curve(columns, joints, curve, path, None if said is None else said.blend_s)
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
        q, v, a = robot.mechanism.complete_motion(q, v, a)
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


@raised_as(MotionError)
def _read_statement(metadata: Any, path: Path) -> MotionDocument | None:
    """What a file says of itself; None for one that was made elsewhere."""
    if metadata == {}:
        return None
    if not isinstance(metadata, Mapping):
        raise MotionError(
            "is no JSON object", source=path, field="metadata", remedy="write it with save_motion"
        )
    if set(metadata) <= {"robot", "robot_hash", "curve", "blend_s"}:
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
    return check_content(MotionDocument, dict(metadata), path, remedy="check that it is a motion")


def _motion_metadata(said: MotionDocument | None, digest: str) -> MotionMetadata:
    if said is None:
        return MotionMetadata(generator="elsewhere")
    stated_hash = "" if said.content_hash == digest else said.content_hash
    own = {name: getattr(said, name) for name in (*_STATED, "verdict")}
    return MotionMetadata(**own, stated_hash=stated_hash)


# Columns of a motion's file, checked before they become a motion: numbers, of one length, in order of time.


def numeric_columns(columns: Mapping[str, NDArray[Any]], path: Path) -> dict[str, Array]:
    """Columns of ``excite.motion/1`` as numbers, each of one axis, of equal length and finite; raises MotionError."""
    found = {
        name: _read_column(column, name, path)
        for name, column in columns.items()
        if name == "time" or name.partition(".")[0] in {"q", "v", "a", "base", "contact"}
    }
    rows = len(next(iter(found.values()), ()))
    for name, values in found.items():
        if len(values) != rows:
            what = f"has {len(values)} rows, others have {rows}"
            raise MotionError(what, source=path, field=name, remedy="align the columns")
    return found


def _read_column(column: NDArray[Any], name: str, path: Path) -> Array:
    refusal = partial(MotionError, source=path, field=name)
    if np.ndim(column) != 1:
        raise refusal(f"has the shape {np.shape(column)}", remedy="write one number a row")
    try:
        if np.asarray(column).dtype.kind not in "fiub":
            raise TypeError(f"values are {str(np.asarray(column)[:1])[:40]}")
        values = np.asarray(column, dtype=float)
    except (TypeError, ValueError) as error:
        raise refusal(f"is not numeric ({error})", remedy="write numbers only") from error
    if not np.isfinite(values).all():
        row = int(np.argmax(~np.isfinite(values)))
        raise refusal(f"is {values[row]} in row {row}", remedy="remove NaN and infinity")
    return values


def check_joints(columns: Iterable[str], robot: Robot, path: Path, whose: str) -> None:
    """Raise MotionError where columns are of joints that the robot lacks, ``whose`` robot the file says it is for."""
    found = {name.partition(".")[2] for name in columns if name.startswith(("q.", "v.", "a."))}
    unknown = sorted(found - set(robot.joint_names))
    if unknown and whose not in ("", robot.name):
        raise OtherRobotError(whose, robot.name, path)
    if unknown:
        lacks = unknown[0] not in robot.description.locked_joints
        raise MotionError(
            f"robot {robot.name!r} " + ("has no such joint" if lacks else "holds this joint still"),
            source=path,
            field=f"q.{unknown[0]}",
            remedy="check the robot"
            if lacks
            else "leave its columns out, or state its range in the model and take it from locked_joints in robot.yaml",
        )


def check_time(columns: Mapping[str, Array], path: Path) -> None:
    """Raise MotionError where the time [s] is missing, too short or does not increase."""
    refusal = partial(MotionError, source=path, field="time")
    if "time" not in columns:
        raise refusal("column is missing", remedy="add the time of each row [s]")
    time = columns["time"]
    if len(time) < 3:
        raise refusal(f"has {len(time)} samples", remedy="at least 3 are needed")
    falls = np.diff(time) <= 0.0
    if falls.any():
        at = float(time[int(np.argmax(falls))])
        raise refusal(f"does not increase after {at:.4f} s", remedy="sort the samples")


def stack_columns(columns: Mapping[str, Array], names: Iterable[str], path: Path) -> Array:
    """Columns side by side, ``(n, len(names))``; raises MotionError where one is missing."""
    missing = [name for name in names if name not in columns]
    if missing:
        raise MotionError("column is missing", source=path, field=missing[0], remedy="add it")
    return np.column_stack([columns[name] for name in names])


# Velocities and accelerations of motions that state positions alone.

# What a spline needs for its end conditions.
_LEAST_SAMPLES = 4


def with_derivatives(columns: Mapping[str, Array], joints: Sequence[str], path: Path) -> dict[str, Array]:
    """Columns of a motion with the velocities and accelerations of its joints that were not there.

    Of positions, those of the cubic spline through them whose third derivative does not jump at the second sample
    and the last but one: a start from rest with any constant acceleration is met exactly. Of stated velocities, the
    accelerations of the same spline through them. All joints state a quantity, or none does.

    Args:
        columns: ``(n,)`` each, ``time`` [s] and ``q.JOINT`` [rad or m] among them.
        joints: of the robot.
        path: the file, for errors.

    Raises:
        MotionError: some joints state velocities or accelerations and some do not, or there are too few samples.
    """
    found = dict(columns)
    for below, wanted in (("q", "v"), ("v", "a")):
        missing = [joint for joint in joints if f"{wanted}.{joint}" not in found]
        if not missing or any(f"{below}.{joint}" not in found for joint in joints):
            continue
        if len(missing) < len(joints):
            raise MotionError(
                "column is missing",
                source=path,
                field=f"{wanted}.{missing[0]}",
                remedy=f"state it for every joint, or for none and it is that of a spline through {below}",
            )
        if len(found["time"]) < _LEAST_SAMPLES:
            raise MotionError(
                f"has {len(found['time'])} samples", source=path, field="time", remedy="at least 4 are needed"
            )
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(found["time"], np.column_stack([found[f"{below}.{joint}"] for joint in joints]))
        rates = spline(found["time"], 1)
        found |= {f"{wanted}.{joint}": rates[:, i] for i, joint in enumerate(joints)}
        if wanted == "v" and not any(f"a.{joint}" in found for joint in joints):
            accelerations = spline(found["time"], 2)
            found |= {f"a.{joint}": accelerations[:, i] for i, joint in enumerate(joints)}
    return found


def thinned(motion: Motion, every: int) -> Motion:
    """Every so manieth sample of a motion and the last, accelerations those of the cubic spline through the joints'
    positions: rounding of positions makes third derivatives wrong by its size over the step's cube.
    """
    from scipy.interpolate import CubicSpline

    rows = np.r_[
        np.arange(0, motion.n_samples - 1, every)[: (motion.n_samples - 1) // every], motion.n_samples - 1
    ]
    time, a = motion.time[rows], motion.a[rows]
    a[:, motion.a.shape[1] - len(motion.joint_names) :] = CubicSpline(time, motion.joint_positions()[rows])(
        time, 2
    )
    return replace(motion, time=time, q=motion.q[rows], v=motion.v[rows], a=a)


# Columns of a motion in a Parquet file, in full or in as few bytes as a plan needs.


def _narrow_column(name: str, column: NDArray[Any]) -> NDArray[Any]:
    """A column in few bytes: positions in single precision, velocities and accelerations to 16 binary digits."""
    if name == "time":
        return column
    if column.dtype != float:
        return column.astype(np.int8)
    single = column.astype(np.float32)
    if name.startswith(("q.", "base.p", "base.q")):
        return single
    return ((single.view(np.uint32) + np.uint32(0x80)) & np.uint32(0xFFFFFF00)).view(np.float32)
