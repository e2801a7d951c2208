"""LeRobot data sets, layouts 2.1 and 3.0: ``meta/info.json`` and Parquet files of episodes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.arrow import parquet_arrays
from excite.formats.documents import read_json
from excite.formats.file import MAX_FILE_BYTES, check_file

_INFO = Path("meta") / "info.json"
# Columns that count rows and hold nothing of a robot.
COUNTING = frozenset(
    ("timestamp", "frame_index", "episode_index", "index", "task_index", "next.done", "next.reward")
)
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
_PLACE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def is_data_set(path: Path) -> bool:
    """Whether a folder is one."""
    return (path / _INFO).is_file()


@dataclass(frozen=True, eq=False)
class DataSet:
    """A data set on disk.

    Attributes:
        path: its folder.
        fps: rows a second [Hz]; 0 where it does not say.
        features: what each column holds, by name.
        files: Parquet files with episodes, in order.
    """

    path: Path
    fps: float
    features: Mapping[str, Any]
    files: tuple[Path, ...]

    def names(self, feature: str) -> list[str]:
        """Names of a feature's numbers, which may stand in lists within lists or dictionaries, one a motor."""
        return _flatten_names(self.features.get(feature, {}).get("names") or [])

    def episodes(self) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
        """Number and rows of each episode: ``(n,)`` or ``(n, k)`` by feature, and ``time`` [s] where it is known."""
        for file in self.files:
            arrays = parquet_arrays(check_file(file, limit=MAX_FILE_BYTES))
            n = max((len(values) for values in arrays.values()), default=0)
            index = arrays.get("episode_index", np.zeros(n)).astype(int)
            for episode in np.unique(index):
                rows = index == episode
                found = {name: values[rows] for name, values in arrays.items()}
                frames = found.get("frame_index", np.arange(int(rows.sum())))
                if self.fps > 0.0 or "timestamp" in found:
                    found["time"] = found["timestamp"] if "timestamp" in found else frames / self.fps
                yield int(episode), found


def read_data_set(path: Path) -> DataSet:
    """What a data set says of itself; raises InputError where that is no JSON, or there are no episodes."""
    info = read_json(path / _INFO)
    files = tuple(sorted((path / "data").glob("**/*.parquet")))
    if not files:
        raise InputError(
            "has no Parquet files", source=path / "data", remedy="download the data set's data folder"
        )
    fps, features = info.get("fps") or 0.0, info.get("features", {})
    if not isinstance(fps, int | float) or not isinstance(features, Mapping):
        raise InputError(
            "has no number fps and no features by name", source=path / _INFO, remedy="download it again"
        )
    return DataSet(path, float(fps), features, files)


def _flatten_names(names: Any) -> list[str]:
    if isinstance(names, Mapping):
        return [name for inner in names.values() for name in _flatten_names(inner)]
    if isinstance(names, list):
        return [name for inner in names for name in _flatten_names(inner)]
    return [str(names)]


def write_data_set(
    columns: Mapping[str, NDArray[Any]],
    names: Mapping[str, list[str]],
    folder: Path,
    *,
    fps: int,
    robot: str,
    task: str,
) -> None:
    """Write a data set of one episode, layout 3.0.

    Args:
        columns: ``(n, k)`` by feature, in single precision as everywhere there.
        names: of each feature's numbers.
        folder: where to.
        fps: rows a second [Hz].
        robot: what kind it is.
        task: what the episode is said to do.
    """
    n = len(next(iter(columns.values())))
    zero = np.zeros(n, dtype=np.int64)
    table: dict[str, NDArray[Any]] = {**columns, "timestamp": (np.arange(n) / fps).astype(np.float32)}
    table |= {name: zero for name in _INDICES} | {name: np.arange(n) for name in ("frame_index", "index")}
    features = {
        name: {
            "dtype": str(values.dtype),
            "shape": [values.shape[1] if values.ndim > 1 else 1],
            "names": names.get(name),
        }
        for name, values in table.items()
    }
    info = {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "fps": fps,
        "total_episodes": 1,
        "total_frames": n,
        "total_tasks": 1,
        "chunks_size": 1000,
        "splits": {"train": "0:1"},
        "data_path": _PLACE,
        "video_path": None,
        "features": features,
    }
    stats = {name: _feature_stats(values) for name, values in table.items()}
    _write_table(_episode_table(table), folder / _PLACE.format(chunk_index=0, file_index=0))
    meta = folder / "meta"
    _write_text(folder / _INFO, info)
    _write_text(meta / "stats.json", stats)
    tasks = pa.table({"task_index": [0], "task": [task]})
    _write_table(tasks.replace_schema_metadata({"pandas": json.dumps(_TASKS)}), meta / "tasks.parquet")
    places = ("data/chunk_index", "data/file_index", "meta/episodes/chunk_index", "meta/episodes/file_index")
    episode = {
        "episode_index": [0],
        "tasks": [[task]],
        "length": [n],
        **{key: [0] for key in places[:2]},
        "dataset_from_index": [0],
        "dataset_to_index": [n],
        **{key: [0] for key in places[2:]},
    }
    _write_table(pa.table(episode), meta / "episodes" / "chunk-000" / "file-000.parquet")


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


def _write_table(table: pa.Table, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pa.parquet.write_table(table, path)


def _write_text(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
