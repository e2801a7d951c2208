"""Files of motion laboratories: C3D, TRC, MOT, STO and CSV, and which of them belong together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.formats.c3d import MAX_C3D_BYTES, read_c3d
from excite.formats.file import plain_name, unpack_file
from excite.formats.markers import read_storage, read_trc
from excite.formats.tables import numbers_of_words, read_table
from excite.human.recording import PlateRecording, Recording

# Units and clocks.

METRES: dict[str, float] = {"m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}


def checked_time(time: Array, path: Path) -> Array:
    """Time stamps, finite and rising; raises LogError."""
    if len(time) < 2:
        raise LogError(f"has {len(time)} rows", source=path, field="time", remedy="record longer")
    bad = np.flatnonzero(~(np.diff(time) > 0.0))
    if not np.isfinite(time).all() or len(bad):
        row = int(bad[0]) + 1 if len(bad) else int(np.argmax(~np.isfinite(time)))
        raise LogError(f"does not rise at row {row}", source=path, field="time", remedy="export it again")
    return time


def metres_per_unit(unit: str, path: Path) -> float:
    """Factor to metres; raises LogError for a unit that is none of length."""
    if unit.strip().lower() not in METRES:
        raise LogError(f"is {unit.strip()[:30]!r}", source=path, field="units", remedy="use m, cm or mm")
    return METRES[unit.strip().lower()]


# C3D.


def read_c3d_file(path: Path) -> Recording:
    """Read by ezc3d, which turns the channels of plates of types 1 to 7 to force and moment in the laboratory."""
    raw = read_c3d(path, LogError)
    n = raw.points.shape[2]
    if n < 2 or not 0.0 < raw.rate_hz < np.inf:
        raise LogError(f"has {n} frames at {raw.rate_hz:g} Hz", source=path, remedy="record longer")
    unit = metres_per_unit(raw.unit, path)
    position = raw.points[:3].transpose(2, 1, 0) * unit
    missing = ~np.isfinite(position).all(axis=2) | (position == 0.0).all(axis=2)
    missing |= raw.residuals.T < 0.0
    position[missing] = np.nan
    time = np.arange(n) / raw.rate_hz
    _check_labels(raw.labels, path)
    markers = {label: position[:, i] for i, label in enumerate(raw.labels) if i < position.shape[1]}
    plates = tuple(_read_plate(plate, i, unit, time, path) for i, plate in enumerate(raw.plates))
    return Recording(path, time, markers, plates)


def _check_labels(labels: tuple[str, ...], path: Path) -> None:
    """Points without a name have none, an asterisk or a number after one; every other name stands once."""
    names = Counter(label for label in labels if label.strip() and not label.startswith("*"))
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise LogError("stands twice", source=path, field=twice[0][:60], remedy="rename one of them")


def _read_plate(plate: Any, index: int, length: float, time: np.ndarray, path: Path) -> PlateRecording:
    """Force and moment of a plate on the person, about the laboratory's origin.

    ezc3d gives moments about the centre of the surface; both come as the plate's reaction.
    """
    moment_unit = {"Nmm": 1e-3, "Nm": 1.0, "N.m": 1.0, "Ncm": 1e-2}
    unit = plate["unit_moment"] or "Nmm"
    if unit not in moment_unit:
        raise LogError(
            f"is {unit[:30]!r}", source=path, field=f"plate {index + 1}, moment", remedy="use Nmm or Nm"
        )
    force, about_center = plate["force"].T, plate["moment"].T * moment_unit[unit]
    place = plate["unit_position"]
    corners = plate["corners"].T * (metres_per_unit(place, path) if place else length)
    if force.shape != about_center.shape or force.shape[1:] != (3,) or corners.shape != (4, 3):
        raise LogError(
            "has channels of another kind", source=path, field=f"plate {index + 1}", remedy="export it again"
        )
    force, about_center = (
        np.where(np.isnan(force), 0.0, force),
        np.where(np.isnan(about_center), 0.0, about_center),
    )
    moment = about_center + np.cross(corners.mean(axis=0), force)
    at = np.arange(len(force)) * (time[1] - time[0]) * len(time) / max(len(force), 1)
    return PlateRecording(f"plate_{index + 1}", at, force, moment, corners)


# Plain tables: time, three columns of each marker, and forces with moments or centres of pressure of each plate.

# A unit that is not known: what it is shows in the person's weight.
_OTHER_UNIT = re.compile(r"\s*(?:\[[^\[\]]*\]|\([^()]*\))\s*$")


def read_csv_file(path: Path) -> Recording:
    """One row a frame; an empty field is a missing marker; of what is sampled less often, rows between are empty.

    Names are those of :func:`columns_of`. Moments are about the file's origin; where there is a centre of pressure,
    moments are its force's, and the torque that there is besides.
    """
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
        _OTHER_UNIT.sub("", label): numbers_of_words(values, label, path, found_table.dress.skip, LogError)
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


# MOT and STO files of OpenSim that hold ground reaction forces, and TRC files of markers.


def read_storage_file(path: Path) -> Recording:
    """``NAME_vx … vz`` forces [N], ``NAME_px … pz`` points of application [m], torques ``…torque…x … z`` [N·m]."""
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


def read_trc_file(path: Path) -> Recording:
    """Markers alone."""
    found = read_trc(path, LogError)
    points = found.points * metres_per_unit(found.unit, path)
    markers = {label: points[:, i] for i, label in enumerate(found.labels)}
    return Recording(path, checked_time(found.time, path), markers)


# Bounds of what a motion laboratory can have measured, whatever the format.

# Markers are a few metres from the origin, and in a file of millimetres that claims metres some thousands [m].
_FARTHEST = 1e6
# A jump has ten times a person's weight; a moment about the origin may be in N·mm [N, N·m].
_LARGEST_FORCE, _LARGEST_MOMENT = 1e6, 1e9
_MOST_MARKERS = 20_000
# Cameras of motion laboratories take 30 to 1000 frames a second [Hz].
_SLOWEST_HZ, _FASTEST_HZ = 5.0, 1e5
# Frames come at one rate: a longer step is a frame that is not there.
_LONGEST_STEP = 1.5
_PLAUSIBLE_REMEDY = "export it again"


def check_recording(recording: Recording) -> Recording:
    """The recording, if markers and plates are within bounds; raises LogError that names the channel."""
    path = recording.source
    if len(recording.markers) > _MOST_MARKERS:
        raise LogError(f"has {len(recording.markers)} markers", source=path, remedy=_PLAUSIBLE_REMEDY)
    if recording.markers:
        _check_frames(recording.time, path)
    for label, values in recording.markers.items():
        largest = np.abs(values, where=~np.isnan(values), out=np.zeros_like(values)).max(initial=0.0)
        if not largest <= _FARTHEST:
            raise LogError(
                f"lies {largest:.3g} m away", source=path, field=label[:60], remedy=_PLAUSIBLE_REMEDY
            )
    for plate in recording.plates:
        _check_plate(plate, path)
    return recording


def _check_frames(time: Array, path: Path) -> None:
    step = np.diff(time)
    usual = float(np.median(step))
    if not 1.0 / _FASTEST_HZ <= usual <= 1.0 / _SLOWEST_HZ:
        raise LogError(f"frames come every {usual:.3g} s", source=path, field="time", remedy="write seconds")
    if step.max() > _LONGEST_STEP * usual:
        row = int(np.argmax(step))
        raise LogError(
            f"leaps by {step[row]:.4g} s after {time[row]:.6g} s, where frames come every {usual:.3g} s",
            source=path,
            field="time",
            remedy="write a row for each frame, with empty fields for what was not seen",
        )


def _check_plate(plate: PlateRecording, path: Path) -> None:
    corners = np.zeros(0) if plate.corners is None else plate.corners
    for name, values, largest in (
        ("force", plate.force, _LARGEST_FORCE),
        ("moment", plate.moment, _LARGEST_MOMENT),
        ("corners", corners, _FARTHEST),
    ):
        if not np.isfinite(values).all():
            raise LogError(
                "is not finite", source=path, field=f"{plate.name[:60]}, {name}", remedy="write every number"
            )
        if np.abs(values).max(initial=0.0) > largest:
            raise LogError(
                f"reaches {np.abs(values).max():.3g}",
                source=path,
                field=f"{plate.name[:60]}, {name}",
                remedy=_PLAUSIBLE_REMEDY,
            )


# Which reader answers to which ending.

READERS: dict[str, Callable[[Path], Recording]] = {
    ".c3d": read_c3d_file,
    ".trc": read_trc_file,
    ".mot": read_storage_file,
    ".sto": read_storage_file,
    ".csv": read_csv_file,
}


def read_recording(path: Path) -> Recording:
    """Read a file by its ending; a format without markers gives a recording without any.

    Raises:
        LogError: no reader for it, or it is malformed.
    """
    read = READERS.get(plain_name(path).suffix.lower())
    if read is None:
        known = ", ".join(READERS)
        raise LogError(f"no reader for {path.suffix[:60]!r}", source=path, remedy=f"use one of {known}")
    with unpack_file(path, limit=MAX_C3D_BYTES, error=LogError) as plain:
        return check_recording(replace(read(plain), source=path))


# Which files belong together: markers with their forces, and standing recordings apart.

_STANDING = ("static", "stand", "cal")


def paired_recordings(
    trials: Sequence[Path], static: Sequence[Path] = ()
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Read files and join markers with forces.

    Forces belong to the markers' file of the same name but for its ending; where names differ, they are paired in
    the order given. A file of markers without forces is a standing recording if its name says so (``static``).

    Args:
        trials: files with markers, forces, or both.
        static: standing recordings.

    Returns:
        Trials with markers and forces; standing recordings.

    Raises:
        LogError: markers without forces or forces without markers.
    """
    read = [read_recording(path) for path in trials]
    whole = [r for r in read if r.markers and r.plates]
    bare = [r for r in read if r.markers and not r.plates]
    forces = [r for r in read if not r.markers]
    standing = [read_recording(path) for path in static]
    for recording in standing:
        if not recording.markers:
            raise LogError("has no markers", source=recording.source, remedy="give a recording of standing")
    named = {force.source.stem: force for force in forces}
    joined, left = [], []
    for recording in bare:
        force = named.pop(recording.source.stem, None)
        if force is None:
            left.append(recording)
        else:
            joined.append(_join_recordings(recording, force))
    rest = list(named.values())
    moving = [r for r in left if not _is_standing(r)]
    if len(rest) != len(moving) and len(rest) == len(left):
        moving = left
    standing += [r for r in left if r not in moving]
    if len(rest) < len(moving):
        raise LogError(
            "has no force plates",
            source=moving[len(rest)].source,
            remedy="give the file with its forces (MOT, STO) of the same name, or pass it with --static",
        )
    if len(rest) > len(moving):
        raise LogError(
            "has forces only", source=rest[len(moving)].source, remedy="give the file with its markers too"
        )
    joined += [_join_recordings(markers, force) for markers, force in zip(moving, rest, strict=True)]
    order = {path: i for i, path in enumerate(trials)}
    found = sorted((*whole, *joined), key=lambda r: order[r.source])
    if not found:
        raise LogError(
            "no trial with markers and forces", remedy="give C3D files, or TRC and MOT files together"
        )
    return tuple(found), tuple(standing)


def _join_recordings(markers: Recording, forces: Recording) -> Recording:
    return replace(markers, plates=forces.plates)


def _is_standing(recording: Recording) -> bool:
    stem = recording.source.stem.lower()
    return any(word in stem for word in _STANDING)
