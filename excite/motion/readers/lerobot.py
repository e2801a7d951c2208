"""LeRobot data sets of one episode, as a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from excite.arrow_columns import numpy_columns, read_parquet
from excite.errors import MotionError
from excite.motion.readers.reader import (
    DAMAGED,
    MAX_FILE_BYTES,
    MotionReader,
    RawMotion,
    unreadable,
)
from excite.motion.readers.remarks import of_robot
from excite.reading.file import check_file
from excite.reading.json_document import read_json

STATEMENT = Path("meta") / "excite.json"
"""Whose motion a data set is, in its folder, where export wrote it."""

_FEATURES = {"action": ("q", ".pos"), "observation.velocity": ("v", ".vel")}


class LeRobotReader(MotionReader):
    """The actions of the only episode in radians, ``JOINT.pos`` or ``JOINT``; with velocities where they are there."""

    name: ClassVar[str] = "lerobot"
    summary: ClassVar[str] = "LeRobot data set of one episode, in radians"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return (path / "meta" / "info.json").is_file()

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        info = read_json(path / "meta" / "info.json", error=MotionError)
        files = sorted((path / "data").glob("**/*.parquet"))
        if len(files) != 1:
            raise MotionError(
                f"holds {len(files)} files of episodes",
                source=path / "data",
                remedy="give a data set of one episode",
            )
        check_file(files[0], limit=MAX_FILE_BYTES, error=MotionError)
        try:
            table = read_parquet(files[0])
            columns = _dataset_columns(table, info, path)
        except DAMAGED as error:
            raise unreadable(files[0], error) from error
        except (KeyError, TypeError, AttributeError) as error:
            raise unreadable(path / "meta" / "info.json", f"it lacks {error}") from error
        said: Mapping[str, Any] = {}
        if (path / STATEMENT).is_file():
            said = read_json(path / STATEMENT, error=MotionError)
        return RawMotion(columns, of_robot(said))


def _dataset_columns(table: pa.Table, info: Mapping[str, Any], path: Path) -> dict[str, NDArray[Any]]:
    numbers = numpy_columns(
        table.select([n for n in table.column_names if not pa.types.is_nested(table[n].type)])
    )
    if np.unique(numbers["episode_index"]).size != 1:
        raise MotionError("holds several episodes", source=path, remedy="give a data set of one episode")
    # Stamps are in single precision, which at a minute is off by microseconds.
    columns = {"time": np.asarray(numbers["frame_index"], dtype=float) / float(info["fps"])}
    for feature, (channel, ending) in _FEATURES.items():
        if feature not in info["features"]:
            continue
        names = info["features"][feature]["names"]
        values = np.array(table[feature].to_pylist(), dtype=float)
        if values.ndim != 2 or values.shape[1] != len(names):
            raise MotionError(
                f"has the shape {values.shape} for {len(names)} names",
                source=path,
                field=feature,
                remedy="name each",
            )
        columns |= {f"{channel}.{str(n).removesuffix(ending)}": values[:, i] for i, n in enumerate(names)}
    return columns
