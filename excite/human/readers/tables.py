"""Recordings of people in text tables: CSV, TRC, and the MOT and STO files of OpenSim."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.formats.markers import read_storage, read_trc
from excite.formats.tables import numbers_of_words, read_table
from excite.human.readers.reader import (
    RecordingReader,
    checked_time,
    metres_per_unit,
)
from excite.human.recording import PlateRecording, Recording

# Plain tables: time, three columns of each marker, and forces with moments or centres of pressure of each
# plate.


# A unit that is not known: what it is shows in the person's weight.
_OTHER_UNIT = re.compile(r"\s*(?:\[[^\[\]]*\]|\([^()]*\))\s*$")


class CsvReader(RecordingReader):
    """One row a frame; an empty field is a missing marker; of what is sampled less often, rows between are empty.

    Names are those of :func:`~excite.human.readers.tables.columns_of`. Moments are about the file's origin; where
    there is a centre of pressure, moments are its force's, and the torque that there is besides.
    """

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        found_table = read_table(path, error=LogError)
        named = columns_of([_OTHER_UNIT.sub("", label) for label in found_table.columns])
        if named.time is None:
            raise LogError(
                "has no column time",
                source=path,
                remedy="name the columns above the rows, one of them time; of Motive or Nexus export C3D, which holds "
                "the plates too",
            )
        table = {
            _OTHER_UNIT.sub("", label): numbers_of_words(
                values, label, path, found_table.dress.skip, LogError
            )
            for label, values in found_table.in_si(path, LogError).items()
            if label
        }
        time = checked_time(table[named.time], path)
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
            [table[plate.columns[key]] if key in plate.columns else level for key in ("px", "py", "pz")]
        )
        # Of an unloaded plate no centre of pressure is known.
        point = np.where(np.isfinite(point).all(axis=1, keepdims=True), point, 0.0)
        torque = np.zeros_like(force)
        for k, axis in enumerate("xyz"):
            if f"t{axis}" in plate.columns:
                torque[:, k] = table[plate.columns[f"t{axis}"]]
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


def _column_vector(table: Mapping[str, Array], axes: Mapping[str, str], stem: str, path: Path) -> Array:
    missing = [axis for axis in "xyz" if axis not in axes]
    if missing:
        raise LogError(
            "column is missing", source=path, field=f"{stem}.{missing[0]}"[:60], remedy="write all components"
        )
    return np.column_stack([table[axes[axis]] for axis in "xyz"])


# What the columns of a laboratory's table are, by their names: time, markers, and what plates measured.

_TIMES = {"time", "t", "times", "timestamp", "seconds", "sec"}
_BETWEEN_CHARACTERS = " ._:-/"
_BETWEEN = r"[\s._:/\-]*"
_MARKER = re.compile(r"(?P<stem>.+?)(?P<between>[\s._:/\-]*)(?P<axis>[xyzXYZ])")
# FP1_Fx, plate.left.fx, Fx1, Force Plate 2 - COPy, ground_force_r_px.
_PLATE = re.compile(
    rf"(?P<stem>.*?)(?<![a-z])(?P<kind>force|moment|torque|cop|f|m|t|p)[ _]?(?P<axis>[xyz])(?P<tail>{_BETWEEN}\d*)",
    re.IGNORECASE,
)
_KINDS = {"force": "f", "moment": "m", "torque": "t", "cop": "p"}


@dataclass(frozen=True)
class Plate:
    """Columns of one plate by kind and axis, ``fx … fz``; ``mx`` moments, ``tx`` torques, ``px`` centre of pressure."""

    name: str
    columns: dict[str, str] = field(default_factory=dict)

    def has(self, kind: str) -> bool:
        """Whether all three components of a kind are there."""
        return all(kind + axis in self.columns for axis in "xyz")


@dataclass(frozen=True)
class Columns:
    """A table's columns.

    Attributes:
        time: None where no column is called so.
        markers: x, y and z by label of the marker; less than three where the file lacks one.
        plates: those of which there are forces.
    """

    time: str | None
    markers: dict[str, dict[str, str]]
    plates: tuple[Plate, ...]


def columns_of(labels: Sequence[str]) -> Columns:
    """What the columns are.

    Markers end in an axis, ``RSHO.x``, ``RSHO_X``, ``RSHO X (mm)``; forces, moments and centres of pressure of a
    plate share what stands before and behind: ``FP1_Fx``, ``FP1_Mx``, ``FP1_COPx`` or ``Fx1``, ``Mx1``.
    """
    time = next((name for name in labels if name.lower() in _TIMES), None)
    plates: dict[str, Plate] = {}
    for name in labels:
        found = _PLATE.fullmatch(name)
        if found:
            kind = found["kind"].lower()
            whose = (found["stem"] + found["tail"]).strip(_BETWEEN_CHARACTERS)
            key = _KINDS.get(kind, kind) + found["axis"].lower()
            plates.setdefault(whose, Plate(_plate_name(whose))).columns[key] = name
    plates = {whose: plate for whose, plate in plates.items() if plate.has("f")}
    taken = {name for plate in plates.values() for name in plate.columns.values()}
    markers: dict[str, dict[str, str]] = {}
    for name in labels:
        found = _MARKER.fullmatch(name)
        if found and name not in taken and name != time:
            markers.setdefault(found["stem"].strip(), {})[found["axis"].lower()] = name
    # A name that happens to end in x is no marker; one with a dot says that it is.
    markers = {stem: axes for stem, axes in markers.items() if len(axes) == 3 or f"{stem}.x" in labels}
    return Columns(time, markers, tuple(plates.values()))


def _plate_name(whose: str) -> str:
    return re.sub(r"^plate\.", "", whose) or "plate"


# MOT and STO files of OpenSim that hold ground reaction forces.


class StorageReader(RecordingReader):
    """``NAME_vx … vz`` forces [N], ``NAME_px … pz`` points of application [m], torques ``…torque…x … z`` [N·m]."""

    name: ClassVar[str] = "mot"
    suffixes: ClassVar[tuple[str, ...]] = (".mot", ".sto")

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        columns = read_storage(path, LogError)
        time = checked_time(columns["time"], path)
        plates: list[PlateRecording] = []
        for label in columns:
            if not label.endswith("vx"):
                continue
            stem = label[:-2]
            force = _storage_vector(columns, stem + "v", path)
            point = _storage_vector(columns, stem + "p", path)
            torque_stem = stem.replace("force", "torque")
            torque = np.zeros_like(force)
            if f"{torque_stem}x" in columns and torque_stem != stem:
                torque = _storage_vector(columns, torque_stem, path)
            loaded = np.abs(force).max(axis=1) > 0.0
            point = np.where(loaded[:, None], point, 0.0)
            plates.append(
                PlateRecording(
                    name=_storage_plate_name(stem, len(plates)),
                    time=time,
                    force=force,
                    moment=np.cross(point, force) + torque,
                    foot=_stated_foot(stem),
                )
            )
        if not plates:
            raise LogError(
                "has no columns of a ground reaction force (…_vx, …_px, …torque_x)",
                source=path,
                remedy="export forces and points of application",
            )
        return Recording(path, time, {}, tuple(plates))


def _storage_vector(columns: dict[str, Array], stem: str, path: Path) -> Array:
    axes = {axis: f"{stem}{axis}" for axis in "xyz" if f"{stem}{axis}" in columns}
    values = _column_vector(columns, axes, stem, path)
    if not np.isfinite(values).all():
        raise LogError("is not finite", source=path, field=f"{stem}x", remedy="export it again")
    return values


def _stated_foot(stem: str) -> str | None:
    parts = re.split(r"[_.]", stem.lower())
    if {"r", "right"} & set(parts):
        return "right"
    return "left" if {"l", "left"} & set(parts) else None


def _storage_plate_name(stem: str, index: int) -> str:
    foot = _stated_foot(stem)
    return f"plate_{foot}" if foot else f"plate_{index + 1}"


# TRC files of marker positions (Motion Analysis, OpenSim).


class TrcReader(RecordingReader):
    """Markers alone."""

    name: ClassVar[str] = "trc"
    suffixes: ClassVar[tuple[str, ...]] = (".trc",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        found = read_trc(path, LogError)
        points = found.points * metres_per_unit(found.unit, path)
        markers = {label: points[:, i] for i, label in enumerate(found.labels)}
        return Recording(path, checked_time(found.time, path), markers)
