"""Plain tables: ``time``, ``LABEL.x … z`` [m] and ``plate.NAME.fx … fz tx ty tz`` [N, N·m, about the origin]."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.human.readers.reader import RecordingReader, check_labels, checked_time, numbers, read_lines
from excite.human.recording import PlateRecording, Recording

_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")


class CsvReader(RecordingReader):
    """One row a frame; an empty field is a missing marker; plates at the markers' rate."""

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        lines = read_lines(path)
        labels = [label.strip() for label in lines[0].split(",")] if lines else []
        if "time" not in labels:
            raise LogError(
                "has no column time",
                source=path,
                remedy="name the columns in the first line; of Motive or Nexus export C3D, which holds the plates too",
            )
        check_labels(labels, path)
        rows = []
        for place, line in enumerate(lines[1:], start=2):
            if not line.strip():
                continue
            fields = line.split(",")
            if len(fields) != len(labels):
                raise LogError(
                    f"line {place} has {len(fields)} fields for {len(labels)} columns",
                    source=path,
                    remedy="write one field a column, empty for a missing marker",
                )
            rows.append(numbers(fields, path, place))
        data = np.array(rows).reshape(len(rows), len(labels))
        columns = {label: data[:, i] for i, label in enumerate(labels)}
        time = checked_time(columns["time"], path)
        markers, plates = {}, []
        for label in labels:
            if label.startswith("plate.") and label.endswith(".fx"):
                name = label[len("plate.") : -len(".fx")]
                wrench = _group(columns, f"plate.{name}", _WRENCH, path)
                plates.append(PlateRecording(name, time, wrench[:, :3], wrench[:, 3:]))
            elif label.endswith(".x") and not label.startswith("plate."):
                markers[label[:-2]] = _group(columns, label[:-2], ("x", "y", "z"), path)
        return Recording(path, time, markers, tuple(plates))


def _group(columns: dict[str, Array], stem: str, endings: tuple[str, ...], path: Path) -> Array:
    missing = [f"{stem}.{ending}" for ending in endings if f"{stem}.{ending}" not in columns]
    if missing:
        raise LogError("column is missing", source=path, field=missing[0], remedy="write all components")
    return np.column_stack([columns[f"{stem}.{ending}"] for ending in endings])
