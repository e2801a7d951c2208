"""Text files of motion laboratories: TRC with markers (Motion Analysis), MOT and STO with columns (OpenSim)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.file import MAX_TEXT_BYTES, check_unique, read_text
from excite.formats.tables import numbers_of_words, read_table

_END = "endheader"


@dataclass(frozen=True, eq=False)
class Trc:
    """What a TRC file holds.

    Attributes:
        unit: of length, as the file says it.
        time: ``(n,)`` [s].
        labels: of the markers.
        points: ``(n, n_markers, 3)`` in that unit; NaN where a marker was not seen.
    """

    unit: str
    time: NDArray[Any]
    labels: tuple[str, ...]
    points: NDArray[Any]


def read_trc(path: Path, error: type[InputError] = InputError) -> Trc:
    """Header of five lines, then frame, time and three coordinates a marker between tabs; raises ``error``."""
    lines = read_text(path, limit=MAX_TEXT_BYTES, error=error).splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise error("is no TRC file", source=path, remedy="export the markers as TRC")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = {key.strip(): value for key, value in zip(keys, values, strict=False)}
    if "Units" not in header:
        raise error("is missing", source=path, field="Units", remedy="export the markers as TRC")
    labels = [label.strip() for label in lines[3].split("\t")[2:] if label.strip()]
    if not labels:
        raise error("names no markers", source=path, remedy="export it again")
    check_unique(labels, path, error)
    width = 2 + 3 * len(labels)
    rows = []
    for place, line in enumerate(lines[4:], start=5):
        fields = line.split("\t")
        if not fields[0].strip() or fields[0].strip().startswith("X"):
            continue
        # Programs leave out fields at the end of a line where the last markers were not seen.
        if len(fields) > width + 1 and any(field.strip() for field in fields[width:]):
            text = f"line {place} has {len(fields)} fields for {len(labels)} markers"
            raise error(text, source=path, remedy="export it again")
        fields = (fields + [""] * width)[:width]
        try:
            rows.append([float(text) if text.strip() else np.nan for text in fields])
        except ValueError as reason:
            text = f"line {place} is not numeric ({' '.join(str(reason).split())[:80]})"
            raise error(text, source=path, remedy="write numbers only") from reason
    if not rows:
        raise error("holds no frames", source=path, remedy="export it again")
    data = np.array(rows)
    points = data[:, 2:].reshape(len(data), len(labels), 3)
    # Programs write a marker that was not seen as empty fields or as exact zeros.
    points[(points == 0.0).all(axis=2)] = np.nan
    return Trc(header["Units"], data[:, 1], tuple(labels), points)


def read_storage(path: Path, error: type[InputError] = InputError) -> dict[str, NDArray[Any]]:
    """Columns of a MOT or STO file by label, ``(n,)`` each, as they stand in it.

    Raises:
        InputError: of the class ``error``: the header has no end, or a row is malformed.
    """
    table = read_table(path, error=error, below=_END)
    columns = {
        name: numbers_of_words(values, name, path, table.dress.skip, error)
        for name, values in table.columns.items()
    }
    if "time" not in columns or not len(columns["time"]):
        raise error("has no column time", source=path, remedy="export it again")
    return columns
