"""Motions in tables: CSV, Parquet, npz, LeRobot, and rows of numbers for controllers."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import MotionError
from excite.formats.documents import parse_json, read_json
from excite.formats.file import first_bytes
from excite.formats.lerobot import is_data_set, read_data_set
from excite.formats.registry import find_format, read_content
from excite.motion.content import BASE_ACCELERATION, BASE_POSE, BASE_TWIST
from excite.motion.readers.reader import (
    BEGINNING,
    MotionReader,
    RawMotion,
    of_robot,
    stated_in_comments,
)

# Text tables: ``excite.motion/1`` in CSV, and tables of other people's naming with a time and a column a
# joint.

UNSAFE = "UNSAFE"
"""How comments of a file begin that was exported although it fails the check."""

# By what a column of times is called, its unit [s].
_TIMES = {
    **dict.fromkeys(
        ("time", "t", "time_s", "timestamp", "timestamps", "time_from_start", "seconds", "sec", "stamp"), 1.0
    ),
    **dict.fromkeys(("time_ms", "timestamp_ms", "t_ms"), 1e-3),
    **dict.fromkeys(("time_us", "timestamp_us", "t_us"), 1e-6),
    **dict.fromkeys(("time_ns", "timestamp_ns", "t_ns"), 1e-9),
}
# Words before or after a joint's name, and what they say its column holds; no word is a position.
_WORDS = {
    "q": ("", "q", "pos", "position", "positions", "angle", "rad"),
    "v": ("v", "qd", "dq", "vel", "velocity", "velocities", "speed"),
    "a": ("a", "qdd", "ddq", "acc", "accel", "acceleration", "accelerations"),
}
_MEANING = {word: channel for channel, words in _WORDS.items() for word in words}
_SEPARATORS = " ._/:-[]()"


class ColumnsReader(MotionReader):
    """Columns of any format of :data:`~excite.formats.registry.FORMATS`: ``excite.motion/1``, or others' naming.

    Of others, times are called ``time``, ``t``, ``timestamp``, ``time_ms`` or the like. A joint's position is its name
    alone or with ``q``, ``pos``, ``position`` before or after it; velocities and accelerations have ``v``, ``vel``,
    ``velocity`` and ``a``, ``acc``, ``acceleration``. ``joint_names`` beside matrices ``q``, ``v``, ``a`` names their
    columns.
    """

    name: ClassVar[str] = "columns"
    summary: ClassVar[str] = (
        "any table with a time and a column a joint, and excite.motion/1 (.csv, .parquet, .npz, .h5)"
    )

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return find_format(path) is not None

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        content = read_content(path)
        columns = content.of_joints(joints)
        if not columns:
            raise MotionError("holds no columns", source=path, remedy="give a motion")
        metadata: Any = parse_json(content.statement) if content.statement else {}
        if "joint_names" in columns:
            said: dict[str, str] = {
                name: str(columns.pop(name)) for name in ("robot", "robot_hash") if name in columns
            }
            return RawMotion(_columns_of_matrices(columns, path), metadata or said)
        if content.statement:
            return RawMotion(
                columns, {"schema": None, **metadata} if isinstance(metadata, Mapping) else metadata
            )
        return RawMotion(_rename_columns(columns, joints))


def _rename_columns(columns: dict[str, NDArray[Any]], joints: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Columns under the names of ``excite.motion/1``, as far as they mean anything; others keep theirs."""
    renamed: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        unit = _TIMES.get(name.lower())
        if unit is not None:
            renamed["time"] = values if unit == 1.0 else np.asarray(values) * unit
        else:
            renamed[_channel_of(name, joints) or name] = values
    return renamed


def _channel_of(name: str, joints: Sequence[str]) -> str | None:
    """``q.JOINT``, ``v.JOINT`` or ``a.JOINT`` for a column that names a joint."""
    for joint in joints:
        before, found, after = name.partition(joint)
        words = (before.strip(_SEPARATORS).lower(), after.strip(_SEPARATORS).lower())
        if found and (not words[0] or not words[1]):
            meaning = _MEANING.get(words[0] or words[1])
            if meaning is not None:
                return f"{meaning}.{joint}"
    return None


# LeRobot data sets of one episode, as a motion.

STATEMENT = Path("meta") / "excite.json"
"""Whose motion a data set is, in its folder, where export wrote it."""

_FEATURES = {"action": ("q", ".pos"), "observation.velocity": ("v", ".vel")}


class LeRobotReader(MotionReader):
    """The actions of the only episode in radians, ``JOINT.pos`` or ``JOINT``; with velocities where they are there."""

    name: ClassVar[str] = "lerobot"
    summary: ClassVar[str] = "LeRobot data set of one episode, in radians"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return is_data_set(path)

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        data = read_data_set(path)
        first, *others = data.episodes()
        if others:
            raise MotionError("holds several episodes", source=path, remedy="give a data set of one episode")
        if data.fps <= 0.0:
            raise MotionError(
                "says no rows a second", source=path, field="fps", remedy="state them in info.json"
            )
        arrays = first[1]
        # Stamps are in single precision, which at a minute is off by microseconds.
        columns = {"time": np.asarray(arrays["frame_index"], dtype=float) / data.fps}
        for feature, (channel, ending) in _FEATURES.items():
            if feature in arrays:
                names = [f"{channel}.{name.removesuffix(ending)}" for name in data.names(feature)]
                columns |= _matrix_columns(feature, arrays[feature], names, path)
        said = read_json(path / STATEMENT) if (path / STATEMENT).is_file() else {}
        return RawMotion(columns, of_robot(said))


_BASE = {"base_pose": BASE_POSE, "base_twist": BASE_TWIST, "base_acceleration": BASE_ACCELERATION}


def _columns_of_matrices(arrays: dict[str, NDArray[Any]], path: Path) -> dict[str, NDArray[Any]]:
    names = [str(name) for name in np.ravel(arrays.pop("joint_names"))]
    columns: dict[str, NDArray[Any]] = {}
    groups = {prefix: [f"{prefix}.{joint}" for joint in names] for prefix in "qva"}
    for name, wanted in {**groups, **_BASE}.items():
        if name in arrays:
            columns |= _matrix_columns(name, arrays.pop(name), wanted, path)
    return columns | arrays


def _matrix_columns(
    name: str, values: NDArray[Any], wanted: Sequence[str], path: Path
) -> dict[str, NDArray[Any]]:
    """Columns of a matrix ``(n, len(wanted))``; raises MotionError for another shape."""
    if values.ndim != 2 or values.shape[1] != len(wanted):
        raise MotionError(
            f"has the shape {values.shape}, not (n, {len(wanted)})",
            source=path,
            field=name,
            remedy="write one column a joint",
        )
    return {column: values[:, i] for i, column in enumerate(wanted)}


# Rows of numbers for controllers, whose columns a comment at the top names.


class RowsReader(MotionReader):
    """Numbers between spaces, a row a period; ``columns`` and ``rate_hz`` in a comment that is a JSON object."""

    name: ClassVar[str] = "rows"
    summary: ClassVar[str] = "rows of numbers that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if path.suffix != ".txt":
            return False
        start = first_bytes(path, BEGINNING)
        return start.startswith(b"#") and b'"columns": [' in start

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        said = stated_in_comments(path)
        with warnings.catch_warnings():
            # Of a file without rows, which the number of columns tells as well.
            warnings.simplefilter("ignore", UserWarning)
            names, rate = [str(name) for name in said["columns"]], float(said["rate_hz"])
            rows = np.loadtxt(path, ndmin=2)
        if rows.shape[1] != len(names) or rate <= 0.0:
            raise MotionError(
                f"has {rows.shape[1]} columns, and names {len(names)}", source=path, remedy="export it again"
            )
        columns = {name: rows[:, i] for i, name in enumerate(names)}
        return RawMotion({"time": np.arange(len(rows)) / rate, **columns}, of_robot(said))
