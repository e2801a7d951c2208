"""Text tables: ``excite.motion/1`` in CSV, and tables of other people's naming with a time and a column a joint."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from excite.arrow_columns import numpy_columns
from excite.errors import MotionError
from excite.motion.readers.reader import (
    DAMAGED,
    MAX_FILE_BYTES,
    MotionReader,
    RawMotion,
    check_once,
    unreadable,
)
from excite.reading.file import check_file
from excite.reading.json_document import parse_json

COMMENT = b"#"
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


class TableReader(MotionReader):
    """Values separated by commas, semicolons or tabs under one line of names; ``#`` lines before it are comments.

    Times are called ``time``, ``t``, ``timestamp``, ``time_ms`` or the like. A joint's position is its name alone or
    with ``q``, ``pos``, ``position`` before or after it; velocities and accelerations have ``v``, ``vel``, ``velocity``
    and ``a``, ``acc``, ``acceleration``.
    """

    name: ClassVar[str] = "csv"
    summary: ClassVar[str] = "any table in text with a time and a column a joint, and excite.motion/1 in CSV"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix in {".csv", ".tsv", ".txt"}

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        check_file(path, limit=MAX_FILE_BYTES, error=MotionError)
        metadata: Any = {}
        try:
            with path.open("rb") as stream:
                start = stream.tell()
                while (line := stream.readline(1 << 20)).startswith(COMMENT):
                    text = line[1:].decode().strip()
                    metadata = parse_json(text) if text.startswith("{") and not metadata else metadata
                    start += len(line)
                names, separator = _column_names(line, path)
                stream.seek(start)
                table = pa.csv.read_csv(
                    stream,
                    # A thread that reads ahead may outlive the interpreter and end it by an abort.
                    pa.csv.ReadOptions(use_threads=False),
                    pa.csv.ParseOptions(delimiter=separator),
                )
            columns = numpy_columns(table.rename_columns(names))
        except DAMAGED as error:
            raise unreadable(path, error) from error
        return RawMotion(columns if metadata else _rename_columns(columns, joints), metadata)


def _column_names(line: bytes, path: Path) -> tuple[list[str], str]:
    """Names of the columns, each once, and what separates them."""
    text = line.decode("utf-8-sig")
    separator = max(",;\t", key=text.count)
    names = [name.strip() for name in next(csv.reader([text.strip("\r\n")], delimiter=separator), [])]
    check_once(names, path)
    return names, separator


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
