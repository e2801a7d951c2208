"""Columns of a motion's file, checked before they become a motion: numbers, of one length, in order of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import MotionError, OtherRobotError
from excite.robot.robot import Robot


def numeric_columns(columns: Mapping[str, NDArray[Any]], path: Path) -> dict[str, Array]:
    """Columns of ``excite.motion/1`` as numbers, each of one axis, of equal length and finite; raises MotionError."""
    found: dict[str, Array] = {}
    rows: int | None = None
    for name, column in columns.items():
        if name != "time" and name.partition(".")[0] not in {"q", "v", "a", "base", "contact"}:
            continue
        values = _read_column(column, name, path)
        rows = len(values) if rows is None else rows
        if len(values) != rows:
            raise MotionError(
                f"has {len(values)} rows, others have {rows}",
                source=path,
                field=name,
                remedy="align the columns",
            )
        found[name] = values
    return found


def _read_column(column: NDArray[Any], name: str, path: Path) -> Array:
    if np.ndim(column) != 1:
        raise MotionError(
            f"has the shape {np.shape(column)}", source=path, field=name, remedy="write one number a row"
        )
    try:
        if np.asarray(column).dtype.kind not in "fiub":
            raise TypeError(f"values are {str(np.asarray(column)[:1])[:40]}")
        values = np.asarray(column, dtype=float)
    except (TypeError, ValueError) as error:
        raise MotionError(
            f"is not numeric ({error})", source=path, field=name, remedy="write numbers only"
        ) from error
    if not np.isfinite(values).all():
        row = int(np.argmax(~np.isfinite(values)))
        raise MotionError(
            f"is {values[row]} in row {row}", source=path, field=name, remedy="remove NaN and infinity"
        )
    return values


def check_joints(columns: Iterable[str], robot: Robot, path: Path, whose: str) -> None:
    """Raise MotionError where columns are of joints that the robot lacks, ``whose`` robot the file says it is for."""
    found = {name.partition(".")[2] for name in columns if name.startswith(("q.", "v.", "a."))}
    unknown = sorted(found - set(robot.joint_names))
    if unknown and whose not in ("", robot.name):
        raise OtherRobotError(whose, robot.name, path)
    if unknown:
        raise MotionError(
            f"robot {robot.name!r} has no such joint",
            source=path,
            field=f"q.{unknown[0]}",
            remedy="check the robot",
        )


def check_time(columns: Mapping[str, Array], path: Path) -> None:
    """Raise MotionError where the time [s] is missing, too short or does not increase."""
    if "time" not in columns:
        raise MotionError(
            "column is missing", source=path, field="time", remedy="add the time of each row [s]"
        )
    time = columns["time"]
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


def stack_columns(columns: Mapping[str, Array], names: Iterable[str], path: Path) -> Array:
    """Columns side by side, ``(n, len(names))``; raises MotionError where one is missing."""
    missing = [name for name in names if name not in columns]
    if missing:
        raise MotionError("column is missing", source=path, field=missing[0], remedy="add it")
    return np.column_stack([columns[name] for name in names])
