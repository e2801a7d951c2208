"""TRC files of marker positions (Motion Analysis, OpenSim)."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.errors import LogError
from excite.human.readers.reader import (
    RecordingReader,
    check_labels,
    checked_time,
    metres_per_unit,
    read_lines,
    row_numbers,
)
from excite.human.recording import Recording


class TrcReader(RecordingReader):
    """Header of five lines, then frame, time and three coordinates a marker, separated by tabs."""

    name: ClassVar[str] = "trc"
    suffixes: ClassVar[tuple[str, ...]] = (".trc",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        lines = read_lines(path)
        if len(lines) < 6 or not lines[0].startswith("PathFileType"):
            raise LogError("is no TRC file", source=path, remedy="export the markers as TRC")
        keys, values = lines[1].split("\t"), lines[2].split("\t")
        header = {key.strip(): value for key, value in zip(keys, values, strict=False)}
        if "Units" not in header:
            raise LogError("is missing", source=path, field="Units", remedy="export the markers as TRC")
        unit = metres_per_unit(header["Units"], path)
        labels = [label.strip() for label in lines[3].split("\t")[2:] if label.strip()]
        if not labels:
            raise LogError("names no markers", source=path, remedy="export it again")
        check_labels(labels, path)
        width = 2 + 3 * len(labels)
        rows = []
        for place, line in enumerate(lines[4:], start=5):
            fields = line.split("\t")
            if not fields[0].strip() or fields[0].strip().startswith("X"):
                continue
            # Programs leave out fields at the end of a line where the last markers were not seen.
            if len(fields) > width + 1 and any(field.strip() for field in fields[width:]):
                raise LogError(
                    f"line {place} has {len(fields)} fields for {len(labels)} markers",
                    source=path,
                    remedy="export it again",
                )
            fields = (fields + [""] * width)[:width]
            rows.append(row_numbers(fields, path, place))
        if not rows:
            raise LogError("holds no frames", source=path, remedy="export it again")
        data = np.array(rows)
        points = data[:, 2:].reshape(len(data), len(labels), 3) * unit
        # Programs write a marker that was not seen as empty fields or as exact zeros.
        points[(points == 0.0).all(axis=2)] = np.nan
        markers = {label: points[:, i] for i, label in enumerate(labels)}
        return Recording(path, checked_time(data[:, 1], path), markers)
