"""Plain tables: time, three columns of each marker, and forces with moments or centres of pressure of each plate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.human.readers.column_names import Column, Plate, columns_of
from excite.human.readers.reader import RecordingReader, check_labels, checked_time, read_lines, row_numbers
from excite.human.readers.table_header import header_of
from excite.human.recording import PlateRecording, Recording

_SEPARATORS = (",", ";", "\t")
# Lines that tell the separator.
_FIRST = 20


class CsvReader(RecordingReader):
    """One row a frame; an empty field is a missing marker; of what is sampled less often, rows between are empty.

    Names are those of :func:`~excite.human.readers.column_names.columns_of`. Moments are about the file's origin; where
    there is a centre of pressure, moments are its force's, and the torque that there is besides.
    """

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        lines = read_lines(path)
        separator = max(_SEPARATORS, key=lambda one: sum(line.count(one) for line in lines[:_FIRST]))
        labels, skip = header_of(lines, separator)
        named = columns_of(labels)
        if named.time is None:
            raise LogError(
                "has no column time",
                source=path,
                remedy="name the columns above the rows, one of them time; of Motive or Nexus export C3D, which holds "
                "the plates too",
            )
        check_labels([label for label in labels if label], path)
        rows = []
        for place, line in enumerate(lines[skip:], start=skip + 1):
            if not line.strip():
                continue
            # Where commas do not separate, they are a decimal point's.
            fields = (line if separator == "," else line.replace(",", ".")).split(separator)
            if len(fields) == len(labels) + 1 and not fields[-1].strip():
                fields = fields[:-1]
            if len(fields) != len(labels):
                raise LogError(
                    f"line {place} has {len(fields)} fields for {len(labels)} columns",
                    source=path,
                    remedy="write one field a column, empty for a missing marker",
                )
            rows.append(row_numbers(fields, path, place))
        data = np.array(rows).reshape(len(rows), len(labels))
        table = {label: data[:, i] for i, label in enumerate(labels)}
        time = checked_time(named.time.factor * table[named.time.label], path)
        markers = {stem: _column_vector(table, axes, stem, path) for stem, axes in named.markers.items()}
        found: list[Finding] = []
        plates = tuple(_table_plate(table, plate, time, path, found) for plate in named.plates)
        frames = _sampled_rows(list(markers.values()), len(time))
        markers = {stem: values[frames] for stem, values in markers.items()}
        plates = tuple(_own_rows(plate) for plate in plates)
        return Recording(path, time[frames], markers, plates, tuple(found))


def _sampled_rows(channels: Sequence[Array], n: int) -> NDArray[np.int64]:
    """Rows in which channels were sampled: every k-th where those between are always empty, else all ``n``."""
    every = np.arange(n)
    if not channels:
        return every
    there = np.flatnonzero(np.isfinite(np.column_stack(channels)).any(axis=1))
    if len(there) < 3:
        return every
    step = int(np.median(np.diff(there)))
    # Frames in which nothing was seen stand between others, on the same grid.
    if step < 2 or ((there - there[0]) % step).any():
        return every
    return np.arange(there[0] % step, n, step)


def _own_rows(plate: PlateRecording) -> PlateRecording:
    rows = _sampled_rows([plate.force], len(plate.time))
    return replace(plate, time=plate.time[rows], force=plate.force[rows], moment=plate.moment[rows])


def _table_plate(
    table: Mapping[str, Array], plate: Plate, time: Array, path: Path, found: list[Finding]
) -> PlateRecording:
    def of(kind: str) -> Array:
        axes = {axis: plate.columns[kind + axis] for axis in "xyz" if kind + axis in plate.columns}
        return _column_vector(table, axes, f"{plate.name}, {kind}", path)

    force = of("f")
    if {"px", "py"} <= plate.columns.keys():
        level = np.zeros(len(time))
        point = np.column_stack(
            [
                _column_values(table, plate.columns[key]) if key in plate.columns else level
                for key in ("px", "py", "pz")
            ]
        )
        # Of an unloaded plate no centre of pressure is known.
        point = np.where(np.isfinite(point).all(axis=1, keepdims=True), point, 0.0)
        torque = np.zeros_like(force)
        for k, axis in enumerate("xyz"):
            if f"t{axis}" in plate.columns:
                torque[:, k] = _column_values(table, plate.columns[f"t{axis}"])
        if not any(f"t{axis}" in plate.columns for axis in "xyz"):
            text = f"{path.name}: {plate.name} has a centre of pressure and no free torque (Tz): it is taken as zero"
            found.append(Finding("free_torque", text, {}, (plate.name,)))
        return PlateRecording(plate.name, time, force, np.cross(point, force) + torque)
    if plate.has("m") or plate.has("t"):
        return PlateRecording(plate.name, time, force, of("m" if plate.has("m") else "t"))
    raise LogError(
        "has forces and neither moments nor a centre of pressure",
        source=path,
        field=plate.name[:60],
        remedy="write Mx, My, Mz about the origin, or COPx, COPy and Tz",
    )


def _column_values(table: Mapping[str, Array], column: Column) -> Array:
    return np.asarray(column.factor * table[column.label])


def _column_vector(table: Mapping[str, Array], axes: Mapping[str, Column], stem: str, path: Path) -> Array:
    missing = [axis for axis in "xyz" if axis not in axes]
    if missing:
        raise LogError(
            "column is missing", source=path, field=f"{stem}.{missing[0]}"[:60], remedy="write all components"
        )
    return np.column_stack([_column_values(table, axes[axis]) for axis in "xyz"])
