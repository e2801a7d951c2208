"""Motion files, ``excite.motion/1``: Parquet, CSV or npz with the same column names."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import arrow_table, numpy_columns, read_parquet
from excite.atomic import atomic_path
from excite.errors import MotionError
from excite.motion.motion import Motion, MotionMetadata
from excite.motion.parquet import write_parquet
from excite.robot.robot import Array, Robot

SCHEMA = "excite.motion/1"
BASE_POSE = tuple(f"base.{name}" for name in ("px", "py", "pz", "qx", "qy", "qz", "qw"))
BASE_TWIST = tuple(f"base.{name}" for name in ("vx", "vy", "vz", "wx", "wy", "wz"))
BASE_ACCELERATION = tuple(f"base.{name}" for name in ("ax", "ay", "az", "alphax", "alphay", "alphaz"))
_CSV_COMMENT = "# "


def motion_columns(motion: Motion) -> dict[str, Array]:
    """Columns of the file, by name, in order."""
    columns: dict[str, Array] = {"time": motion.time}
    if motion.floating:
        columns |= {name: motion.q[:, i] for i, name in enumerate(BASE_POSE)}
        columns |= {name: motion.v[:, i] for i, name in enumerate(BASE_TWIST)}
        columns |= {name: motion.a[:, i] for i, name in enumerate(BASE_ACCELERATION)}
    for prefix, values in (
        ("q", motion.joint_positions()),
        ("v", motion.joint_velocities()),
        ("a", motion.joint_accelerations()),
    ):
        columns |= {f"{prefix}.{joint}": values[:, i] for i, joint in enumerate(motion.joint_names)}
    columns |= {f"contact.{foot}": flags.astype(np.int64) for foot, flags in motion.contacts.items()}
    return columns


def save_motion(motion: Motion, path: Path, *, single: bool = False) -> Path:
    """Write a motion; the format follows the suffix (``.parquet``, ``.csv``, ``.npz``).

    The file appears under its name only when it is complete.

    Args:
        motion: the motion.
        path: where to.
        single: in Parquet, positions in single precision, velocities and accelerations to 16 binary digits: a
            third of the size.

    Raises:
        MotionError: unknown suffix.
    """
    path = Path(path)
    if path.suffix not in {".parquet", ".csv", ".npz"}:
        raise MotionError(f"unknown format {path.suffix!r}", source=path, remedy="use .parquet, .csv or .npz")
    columns = motion_columns(motion)
    metadata = {
        "schema": SCHEMA,
        "robot": motion.robot,
        "robot_hash": motion.metadata.robot_hash,
        "generator": motion.metadata.generator,
        "seed": motion.metadata.seed,
        "targets": list(motion.metadata.targets),
        "versions": dict(motion.metadata.versions),
    }
    with atomic_path(path) as temporary:
        if path.suffix == ".npz":
            np.savez_compressed(temporary, allow_pickle=False, __metadata__=json.dumps(metadata), **columns)
        elif path.suffix == ".csv":
            with temporary.open("wb") as stream:
                stream.write((_CSV_COMMENT + json.dumps(metadata) + "\n").encode())
                pa.csv.write_csv(arrow_table(columns), stream)
        else:
            write_parquet(columns, json.dumps(metadata), temporary, single=single)
    return path


def load_motion(path: Path, robot: Robot) -> Motion:
    """Read a motion file and check it against a robot.

    Args:
        path: a ``.parquet``, ``.csv`` or ``.npz`` file.
        robot: the robot that it is for.

    Returns:
        The motion.

    Raises:
        MotionError: unreadable, wrong schema, missing columns, NaN, unsorted time, joints that the robot lacks.
    """
    path = Path(path)
    columns, metadata = _read_columns(path)
    if metadata.get("schema") != SCHEMA:
        raise MotionError(
            f"schema is {metadata.get('schema')!r}, not {SCHEMA!r}", source=path, field="schema"
        )
    _check_joints(columns, robot, path)
    time = _column(columns, "time", path)
    if len(time) < 3:
        raise MotionError(
            f"has {len(time)} samples", source=path, field="time", remedy="at least 3 are needed"
        )
    step = np.diff(time)
    if (step <= 0.0).any():
        at = float(time[int(np.argmax(step <= 0.0))])
        raise MotionError(
            f"does not increase after {at:.4f} s", source=path, field="time", remedy="sort the samples"
        )
    joints = robot.joint_names
    q, v, a = (_stack(columns, [f"{p}.{joint}" for joint in joints], path) for p in ("q", "v", "a"))
    contacts = {}
    if robot.floating:
        pose = _stack(columns, BASE_POSE, path)
        norm = np.linalg.norm(pose[:, 3:], axis=1)
        if (np.abs(norm - 1.0) > 1e-3).any():
            raise MotionError(
                f"quaternion of norm {norm[int(np.argmax(np.abs(norm - 1.0)))]:.4f}",
                source=path,
                field="base.qw",
            )
        pose[:, 3:] /= norm[:, None]
        q = np.hstack([pose, q])
        v = np.hstack([_stack(columns, BASE_TWIST, path), v])
        a = np.hstack([_stack(columns, BASE_ACCELERATION, path), a])
        contacts = {foot.name: _column(columns, f"contact.{foot.name}", path) > 0.5 for foot in robot.feet}
    return Motion(
        name=path.stem,
        robot=str(metadata.get("robot", robot.name)),
        joint_names=joints,
        time=time,
        q=q,
        v=v,
        a=a,
        contacts=contacts,
        metadata=MotionMetadata(
            generator=str(metadata.get("generator", "unknown")),
            seed=metadata.get("seed"),
            targets=tuple(metadata.get("targets", ())),
            robot_hash=str(metadata.get("robot_hash", "")),
            versions=dict(metadata.get("versions", {})),
        ),
    )


def motion_robot(path: Path) -> str:
    """Name of the robot that a motion file says it is for, empty where it says nothing; raises MotionError."""
    return str(_read_columns(Path(path))[1].get("robot", ""))


def _read_columns(path: Path) -> tuple[dict[str, Array], dict]:
    if path.suffix not in {".parquet", ".csv", ".npz"}:
        raise MotionError(f"unknown format {path.suffix!r}", source=path, remedy="use .parquet, .csv or .npz")
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as archive:
                metadata = json.loads(str(archive["__metadata__"]))
                return {name: archive[name] for name in archive.files if name != "__metadata__"}, metadata
        if path.suffix == ".csv":
            with path.open("rb") as stream:
                first = stream.readline().decode()
                if not first.startswith(_CSV_COMMENT):
                    raise MotionError(
                        "has no metadata line", source=path, remedy="its first line is '# {json}'"
                    )
                table = pa.csv.read_csv(stream)
                metadata = json.loads(first[len(_CSV_COMMENT) :])
        else:
            table = read_parquet(path)
            metadata = json.loads((table.schema.metadata or {}).get(b"excite", b"{}"))
        return numpy_columns(table), metadata
    except (OSError, ValueError, KeyError, BadZipFile, pa.ArrowException) as error:
        text = str(error).split("\n")[0]
        raise MotionError(
            f"cannot be read ({text})", source=path, remedy="check that the file is complete"
        ) from error


def _check_joints(columns: Iterable[str], robot: Robot, path: Path) -> None:
    found = [name[2:] for name in columns if name.startswith("q.")]
    unknown = [name for name in found if name not in robot.joint_names]
    if unknown:
        raise MotionError(
            f"robot {robot.name!r} has no such joint",
            source=path,
            field=f"q.{unknown[0]}",
            remedy="check the robot",
        )
    order = [name for name in robot.joint_names if name in found]
    if found != order:
        raise MotionError(
            "joints are not in the robot's order",
            source=path,
            field="q.*",
            remedy="order them " + ", ".join(order),
        )


def _column(columns: dict[str, Array], name: str, path: Path) -> Array:
    if name not in columns:
        raise MotionError("column is missing", source=path, field=name)
    try:
        values = np.asarray(columns[name], dtype=float)
    except (TypeError, ValueError) as error:
        raise MotionError(f"is not numeric ({error})", source=path, field=name) from error
    if not np.isfinite(values).all():
        row = int(np.argmax(~np.isfinite(values)))
        raise MotionError(
            f"is {values[row]} in row {row}", source=path, field=name, remedy="remove NaN and infinity"
        )
    return values


def _stack(columns: dict[str, Array], names: Iterable[str], path: Path) -> Array:
    return np.column_stack([_column(columns, name, path) for name in names])
