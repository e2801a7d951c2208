"""Motions as plain tables: CSV, NumPy archives, LeRobot data sets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from excite.atomic import atomic_folder, atomic_path
from excite.errors import InputError
from excite.export.exporter import (
    Exporter,
    Setting,
    as_comments,
    motion_remarks,
    motion_statement,
    motion_warnings,
)
from excite.formats.arrow import arrow_table
from excite.motion.content import motion_columns
from excite.motion.motion import Motion
from excite.motion.readers.tables import STATEMENT

# Comma-separated values: a header line with names, then one line a sample.


class CsvExporter(Exporter):
    """Columns ``time`` [s], ``q.JOINT``, ``v.JOINT``, ``a.JOINT`` [SI]; where there are any,
    ``base.*`` and ``contact.*``. A motion that is not safe has its violations, and why it was written all the same, in
    lines above the names that start with ``#``.
    """

    name = "csv"
    suffix = ".csv"
    summary = "comma-separated columns time, q.JOINT, v.JOINT, a.JOINT (and base.*, contact.*)"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        options = pa.csv.WriteOptions(quoting_style="none")
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            stream.write(as_comments(motion_warnings(motion)).encode())
            pa.csv.write_csv(arrow_table(motion_columns(motion)), stream, options)


# LeRobot data sets with one episode: the motion as actions to replay.

_INDICES = ("frame_index", "episode_index", "index", "task_index")
# What pandas has to know of the table of tasks: their texts are its index.
_TASKS = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {"name": n, "field_name": n, "pandas_type": p, "numpy_type": k, "metadata": None}
        for n, p, k in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
}
_FILES = {
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "v2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
}


class LeRobotExporter(Exporter):
    """A data set in LeRobot's layout 3.0 or 2.1, as :data:`settings` say.

    ``action`` and ``observation.state`` are the joints' positions of the motion, ``observation.velocity`` their
    velocities [rad or m, s], named ``JOINT.pos`` and ``JOINT.vel``, in single precision as everywhere there; a robot
    that takes degrees has to be set to radians. Frames are evenly spaced at a whole number a second. Whose motion it is
    and what the check said of it stands in ``meta/excite.json``: LeRobot drops what it does not know from its files.
    """

    name = "lerobot"
    suffix = ""
    summary = "LeRobot data set of one episode, to replay"
    exact = False
    holds_base = False
    settings = (
        Setting("version", "v3.0", "layout of the data set", choices=("v3.0", "v2.1")),
        Setting("task", "excite the robot's dynamics", "what the episode is said to do"),
    )

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """A whole number of frames a second; the motion's own, or twice that, where none is asked for."""
        if asked_hz is None:
            own = (motion.n_samples - 1) / motion.duration
            steps = np.diff(motion.time) * round(own)
            # Samples between those of another grid keep the motion only where they are more.
            return float(round(own) if np.abs(steps - 1.0).max() < 1e-6 else np.ceil(2.0 * own))
        if asked_hz != round(asked_hz):
            raise InputError(
                f"is {asked_hz:g} Hz, and LeRobot counts whole frames a second",
                source=self.name,
                field="rate_hz",
                remedy=f"give {max(1, round(asked_hz))}",
            )
        return asked_hz

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the data set's folder."""
        version, n = self.word("version"), motion.n_samples
        fps = round((n - 1) / motion.duration)
        columns = _dataset_columns(motion, fps)
        info = {
            "codebase_version": version,
            "robot_type": motion.robot,
            "fps": fps,
            "total_episodes": 1,
            "total_frames": n,
            "total_tasks": 1,
            "chunks_size": 1000,
            "splits": {"train": "0:1"},
            "data_path": _FILES[version],
            "video_path": None,
            "features": _dataset_features(motion, columns),
        }
        if version == "v2.1":
            info |= {"total_videos": 0, "total_chunks": 1}
        place = _FILES[version].format(chunk_index=0, file_index=0, episode_chunk=0, episode_index=0)
        stats = {name: _feature_stats(values) for name, values in columns.items()}
        with atomic_folder(path) as folder:
            _write_table(_episode_table(columns), folder / place)
            _write_text(folder / "meta" / "info.json", info)
            _write_text(folder / STATEMENT, motion_statement(motion) | {"remarks": motion_remarks(motion)})
            if version == "v2.1":
                _write_lists(folder / "meta", self.word("task"), n, stats)
            else:
                _write_tables(folder / "meta", self.word("task"), n, stats)


def _dataset_columns(motion: Motion, fps: int) -> dict[str, NDArray[Any]]:
    n = motion.n_samples
    q, v = (x.astype(np.float32) for x in (motion.joint_positions(), motion.joint_velocities()))
    columns: dict[str, NDArray[Any]] = {"action": q, "observation.state": q, "observation.velocity": v}
    columns["timestamp"] = (np.arange(n) / fps).astype(np.float32)
    zero = np.zeros(n, dtype=np.int64)
    return (
        columns
        | {name: zero for name in _INDICES}
        | {name: np.arange(n) for name in ("frame_index", "index")}
    )


def _dataset_features(motion: Motion, columns: dict[str, NDArray[Any]]) -> dict[str, Any]:
    return {
        name: {
            "dtype": str(values.dtype),
            "shape": [values.shape[1] if values.ndim > 1 else 1],
            "names": _feature_names(motion, name) if values.ndim > 1 else None,
        }
        for name, values in columns.items()
    }


def _feature_names(motion: Motion, feature: str) -> list[str]:
    ending = "vel" if feature.endswith("velocity") else "pos"
    return [f"{joint}.{ending}" for joint in motion.joint_names]


def _feature_stats(values: NDArray[Any]) -> dict[str, list[float]]:
    """Statistics by which a policy's inputs are scaled; the deviation is the population's."""
    rows = values.reshape(len(values), -1).astype(float)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(values)]}


def _episode_table(columns: dict[str, NDArray[Any]]) -> pa.Table:
    arrays = [
        pa.array(values)
        if values.ndim == 1
        else pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        for values in columns.values()
    ]
    return pa.Table.from_arrays(arrays, names=list(columns))


def _write_tables(meta: Path, task: str, n: int, stats: dict[str, Any]) -> None:
    """What version 3.0 says of episodes and tasks."""
    _write_text(meta / "stats.json", stats)
    tasks = pa.table({"task_index": [0], "task": [task]})
    _write_table(tasks.replace_schema_metadata({"pandas": json.dumps(_TASKS)}), meta / "tasks.parquet")
    episode = {
        "episode_index": [0],
        "tasks": [[task]],
        "length": [n],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [n],
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    _write_table(pa.table(episode), meta / "episodes" / "chunk-000" / "file-000.parquet")


def _write_lists(meta: Path, task: str, n: int, stats: dict[str, Any]) -> None:
    """What version 2.1 says of episodes and tasks: JSON lines."""
    for name, line in (
        ("tasks", {"task_index": 0, "task": task}),
        ("episodes", {"episode_index": 0, "tasks": [task], "length": n}),
        ("episodes_stats", {"episode_index": 0, "stats": stats}),
    ):
        (meta / f"{name}.jsonl").write_text(json.dumps(line) + "\n", encoding="utf-8")


def _write_table(table: pa.Table, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pa.parquet.write_table(table, path)


def _write_text(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


# NumPy archives: one matrix a quantity.


class NpzExporter(Exporter):
    """Arrays ``time`` (n,), ``q``, ``v``, ``a`` (n, n_joints) [SI] and ``joint_names``; no pickled objects.

    A free base adds ``base_pose`` (n, 7: x y z qx qy qz qw, world frame), ``base_twist`` and
    ``base_acceleration`` (n, 6: linear, angular, base frame); feet add ``contact.FOOT`` (n,) booleans. ``robot``,
    ``robot_hash`` and ``verdict`` (JSON) say whose it is and what the independent check said of it.
    """

    name = "npz"
    suffix = ".npz"
    summary = "NumPy archive with matrices time, q, v, a and joint_names"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`."""
        arrays: dict[str, Any] = {
            "time": motion.time,
            "joint_names": np.array(motion.joint_names),
            "q": motion.joint_positions(),
            "v": motion.joint_velocities(),
            "a": motion.joint_accelerations(),
        }
        if motion.floating:
            arrays |= {
                "base_pose": motion.q[:, :7],
                "base_twist": motion.v[:, :6],
                "base_acceleration": motion.a[:, :6],
            }
        metadata = motion.metadata
        arrays |= {"robot": np.array(motion.robot), "robot_hash": np.array(metadata.robot_hash)}
        if metadata.verdict is not None:
            arrays["verdict"] = np.array(json.dumps(metadata.verdict))
        arrays |= {f"contact.{foot}": flags for foot, flags in motion.contacts.items()}
        with atomic_path(path) as temporary:
            np.savez_compressed(temporary, **arrays)
