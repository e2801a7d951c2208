"""Files of motion laboratories: C3D, TRC, MOT, STO and CSV, and which of them belong together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import LogError, raised_as
from excite.finding import Finding
from excite.formats.file import plain_name, unpack_file
from excite.formats.markers import MAX_C3D_BYTES, read_c3d, read_storage, read_trc
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
    raw = read_c3d(path)
    n = raw.points.shape[2]
    if n < 2 or not 0.0 < raw.rate_hz < np.inf:
        raise LogError(f"has {n} frames at {raw.rate_hz:g} Hz", source=path, remedy="record longer")
    unit = metres_per_unit(raw.unit, path)
    position = raw.points[:3].transpose(2, 1, 0) * unit
    missing = ~np.isfinite(position).all(axis=2) | (position == 0.0).all(axis=2)
    missing |= raw.residuals.T < 0.0
    position[missing] = np.nan
    time = np.arange(n) / raw.rate_hz
    # Points without a name have none, an asterisk or a number after one; every other name stands once.
    names = Counter(label for label in raw.labels if label.strip() and not label.startswith("*"))
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise LogError("stands twice", source=path, field=twice[0][:60], remedy="rename one of them")
    markers = {label: position[:, i] for i, label in enumerate(raw.labels) if i < position.shape[1]}
    plates = tuple(_read_plate(plate, i, unit, time, path) for i, plate in enumerate(raw.plates))
    return Recording(path, time, markers, plates)


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
    force, about_center = (np.where(np.isnan(values), 0.0, values) for values in (force, about_center))
    moment = about_center + np.cross(corners.mean(axis=0), force)
    at = np.arange(len(force)) * (time[1] - time[0]) * len(time) / max(len(force), 1)
    return PlateRecording(f"plate_{index + 1}", at, force, moment, corners)


# Tables: time, three columns of each marker, and forces with moments or centres of pressure of each plate.

# A unit that is not known: what it is shows in the person's weight.
_OTHER_UNIT = re.compile(r"\s*(?:\[[^\[\]]*\]|\([^()]*\))\s*$")
_TIMES = {"time", "t", "times", "timestamp", "seconds", "sec"}
_BETWEEN = r"[\s._:/\-]*"
_MARKER = re.compile(r"(?P<stem>.+?)[\s._:/\-]*(?P<axis>[xyzXYZ])")
# FP1_Fx, plate.left.fx, Fx1, Force Plate 2 - COPy.
_PLATE = re.compile(
    rf"(?P<stem>.*?)(?<![a-z])(?P<kind>force|moment|torque|cop|f|m|t|p)[ _]?(?P<axis>[xyz])(?P<tail>{_BETWEEN}\d*)",
    re.IGNORECASE,
)
# OpenSim's ground_force_vx, ground_force_px, ground_torque_x; FP1_tx; ground_force_r_vx, ground_torque_r_x.
_STORED_PLATE = re.compile(
    rf"(?P<stem>.*?)(?P<kind>(?<![a-z])[vptm]|(?<=torque_)|(?<=torque_[rl]_))(?P<axis>[xyz])(?P<tail>{_BETWEEN}\d*)"
)
_KINDS = {"force": "f", "moment": "m", "torque": "t", "cop": "p", "v": "f", "": "t"}


@dataclass(frozen=True)
class Plate:
    """Columns of one plate by kind and axis, ``fx … fz``; ``mx`` moments, ``tx`` torques, ``px`` centre of pressure."""

    name: str
    columns: dict[str, str] = field(default_factory=dict)

    def columns_by_axis(self, kind: str) -> dict[str, str]:
        """Columns of a kind by axis."""
        return {axis: self.columns[kind + axis] for axis in "xyz" if kind + axis in self.columns}


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


def columns_of(labels: Sequence[str], pattern: re.Pattern[str] = _PLATE) -> Columns:
    """What the columns are.

    Markers end in an axis, ``RSHO.x``, ``RSHO_X``, ``RSHO X (mm)``; forces, moments and centres of pressure of a
    plate share what stands before and behind: ``FP1_Fx``, ``FP1_Mx``, ``FP1_COPx`` or ``Fx1``, ``Mx1``.
    """
    time = next((name for name in labels if name.lower() in _TIMES), None)
    plates: dict[str, Plate] = {}
    for name in labels:
        found = pattern.fullmatch(name)
        if found:
            kind = found["kind"].lower()
            whose = (found["stem"] + found["tail"]).strip(" ._:-/")
            if pattern is _STORED_PLATE:
                # A moment beside a point of application is one about it.
                whose, kind = whose.replace("torque", "force"), kind.replace("m", "t")
            key = _KINDS.get(kind, kind) + found["axis"].lower()
            plate = plates.setdefault(whose, Plate(re.sub(r"^plate\.", "", whose) or "plate"))
            plate.columns[key] = name
    # In a file of forces one component tells of a plate, and the others are missed.
    least = 3 if pattern is _PLATE else 1
    loaded = tuple(plate for plate in plates.values() if len(plate.columns_by_axis("f")) >= least)
    taken = {name for plate in loaded for name in plate.columns.values()}
    markers: dict[str, dict[str, str]] = {}
    for name in labels:
        found = _MARKER.fullmatch(name)
        if found and name not in taken and name != time:
            markers.setdefault(found["stem"].strip(), {})[found["axis"].lower()] = name
    # A name that happens to end in x is no marker; one with a dot says that it is.
    markers = {stem: axes for stem, axes in markers.items() if len(axes) == 3 or f"{stem}.x" in labels}
    return Columns(time, markers, loaded)


def read_csv_file(path: Path) -> Recording:
    """One row a frame; an empty field is a missing marker; of what is sampled less often, rows between are empty.

    Names are those of :func:`columns_of`. Moments are about the file's origin; where there is a centre of pressure,
    moments are its force's, and the torque that there is besides.
    """
    table = read_table(path)
    named = columns_of([_OTHER_UNIT.sub("", label) for label in table.columns])
    if named.time is None:
        raise LogError(
            "has no column time",
            source=path,
            remedy="name the columns above the rows, one of them time; of Motive or Nexus export C3D, which holds "
            "the plates too",
        )
    columns = {
        _OTHER_UNIT.sub("", label): numbers_of_words(values, label, path, table.dress.skip)
        for label, values in table.in_si(path).items()
        if label
    }
    time = checked_time(columns[named.time], path)
    markers = {stem: _column_vector(columns, axes, stem, path) for stem, axes in named.markers.items()}
    findings: list[Finding] = []
    plates = []
    for plate in named.plates:
        read = _table_plate(columns, plate, time, path, findings)
        rows = _sampled_rows([read.force], len(time))
        plates.append(replace(read, time=time[rows], force=read.force[rows], moment=read.moment[rows]))
    frames = _sampled_rows(list(markers.values()), len(time))
    seen = {stem: values[frames] for stem, values in markers.items()}
    return Recording(path, time[frames], seen, tuple(plates), tuple(findings))


def read_storage_file(path: Path) -> Recording:
    """``NAME_vx … vz`` forces [N], ``NAME_px … pz`` points of application [m], torques ``…torque…x … z`` [N·m]."""
    columns = read_storage(path)
    time = checked_time(columns["time"], path)
    plates: list[PlateRecording] = []
    findings: list[Finding] = []
    for plate in columns_of(list(columns), _STORED_PLATE).plates:
        words = set(re.split(r"[_.]", plate.name.lower()))
        foot = "right" if {"r", "right"} & words else "left" if {"l", "left"} & words else None
        named = Plate(f"plate_{foot or len(plates) + 1}", plate.columns)
        plates.append(replace(_table_plate(columns, named, time, path, findings), foot=foot))
    if not plates:
        raise LogError(
            "has no columns of a ground reaction force (…_vx, …_px, …torque_x)",
            source=path,
            remedy="export forces and points of application",
        )
    return Recording(path, time, {}, tuple(plates), tuple(findings))


def _sampled_rows(channels: Sequence[Array], n: int) -> Indices:
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


def _table_plate(
    table: Mapping[str, Array], plate: Plate, time: Array, path: Path, found: list[Finding]
) -> PlateRecording:
    """Forces with moments about the origin, or with points of application and the torque besides."""
    force = _column_vector(table, plate.columns_by_axis("f"), f"{plate.name}, f", path)
    points, torques, moments = (plate.columns_by_axis(kind) for kind in "ptm")
    if len(points) >= 2:
        zero = np.zeros(len(time))
        point, torque = (
            np.column_stack([table.get(axes.get(axis, ""), zero) for axis in "xyz"])
            for axes in (points, torques)
        )
        if len(torques) == 2:
            _column_vector(table, torques, f"{plate.name}, torque", path)
        if not torques:
            text = f"{path.name}: {plate.name} has a centre of pressure and no free torque (Tz): it is taken as zero"
            found.append(Finding("free_torque", text, {}, (plate.name,)))
        # Of an unloaded plate no centre of pressure is known.
        point = np.where(np.isfinite(point).all(axis=1, keepdims=True), point, 0.0)
        return PlateRecording(plate.name, time, force, np.cross(point, force) + torque)
    for axes in (moments, torques):
        if len(axes) == 3:
            return PlateRecording(plate.name, time, force, _column_vector(table, axes, plate.name, path))
    raise LogError(
        "has forces and neither moments nor a centre of pressure",
        source=path,
        field=plate.name[:60],
        remedy="write Mx, My, Mz about the origin, or COPx, COPy and Tz",
    )


def _column_vector(table: Mapping[str, Array], axes: Mapping[str, str], stem: str, path: Path) -> Array:
    for axis in "xyz":
        if axis not in axes:
            field = f"{stem}.{axis}"[:60]
            raise LogError("column is missing", source=path, field=field, remedy="write all components")
    return np.column_stack([table[axes[axis]] for axis in "xyz"])


def read_trc_file(path: Path) -> Recording:
    """Markers alone."""
    found = read_trc(path)
    points = found.points * metres_per_unit(found.unit, path)
    markers = {label: points[:, i] for i, label in enumerate(found.labels)}
    return Recording(path, checked_time(found.time, path), markers)


# Bounds of what a motion laboratory can have measured, whatever the format.

# Markers are a few metres from the origin, and in a file of millimetres that claims metres some thousands [m].
_FARTHEST = 1e6


def check_recording(recording: Recording) -> Recording:
    """The recording, if markers and plates are within bounds; raises LogError that names the channel."""

    def refuse(what: str, field: str | None = None, remedy: str = "export it again") -> NoReturn:
        raise LogError(what, source=recording.source, field=field, remedy=remedy)

    if len(recording.markers) > 20_000:
        refuse(f"has {len(recording.markers)} markers")
    if recording.markers:
        step = np.diff(recording.time)
        usual, row = float(np.median(step)), int(np.argmax(step))
        # Cameras of motion laboratories take 30 to 1000 frames a second [Hz].
        if not 1e-5 <= usual <= 0.2:
            refuse(f"frames come every {usual:.3g} s", "time", "write seconds")
        # Frames come at one rate: a longer step is a frame that is not there.
        if step[row] > 1.5 * usual:
            refuse(
                f"leaps by {step[row]:.4g} s after {recording.time[row]:.6g} s, where frames come every {usual:.3g} s",
                "time",
                "write a row for each frame, with empty fields for what was not seen",
            )
    for channel, values, most in _channels_of(recording):
        largest = np.abs(values).max(initial=0.0)
        if not np.isfinite(values).all() and channel not in recording.markers:
            refuse("is not finite", channel, "write every number")
        if not largest <= most:
            far = channel in recording.markers
            refuse(f"lies {largest:.3g} m away" if far else f"reaches {largest:.3g}", channel[:60])
    return recording


def _channels_of(recording: Recording) -> Iterator[tuple[str, Array, float]]:
    """Names, values and the largest that is possible; of markers where they are seen."""
    for label, values in recording.markers.items():
        yield label, values[~np.isnan(values)], _FARTHEST
    for plate in recording.plates:
        name = plate.name[:60]
        # A jump has ten times a person's weight; a moment about the origin may be in N·mm [N, N·m].
        yield f"{name}, force", plate.force, 1e6
        yield f"{name}, moment", plate.moment, 1e9
        if plate.corners is not None:
            yield f"{name}, corners", plate.corners, _FARTHEST


# Which reader answers to which ending.

READERS: dict[str, Callable[[Path], Recording]] = {
    ".c3d": read_c3d_file,
    ".trc": read_trc_file,
    ".mot": read_storage_file,
    ".sto": read_storage_file,
    ".csv": read_csv_file,
}


@raised_as(LogError)
def read_recording(path: Path) -> Recording:
    """Read a file by its ending; a format without markers gives a recording without any.

    Raises:
        LogError: no reader for it, or it is malformed.
    """
    read = READERS.get(plain_name(path).suffix.lower())
    if read is None:
        known = ", ".join(READERS)
        raise LogError(f"no reader for {path.suffix[:60]!r}", source=path, remedy=f"use one of {known}")
    with unpack_file(path, limit=MAX_C3D_BYTES) as plain:
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
    read, standing = ([read_recording(path) for path in paths] for paths in (trials, static))
    for recording in standing:
        if not recording.markers:
            raise LogError("has no markers", source=recording.source, remedy="give a recording of standing")
    found = [r for r in read if r.markers and r.plates]
    bare = [r for r in read if r.markers and not r.plates]
    forces = {r.source.stem: r for r in read if not r.markers}
    left = [r for r in bare if r.source.stem not in forces]
    pairs = [(r, forces.pop(r.source.stem)) for r in bare if r not in left]
    rest = list(forces.values())
    moving = [r for r in left if not any(word in r.source.stem.lower() for word in _STANDING)]
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
    pairs += zip(moving, rest, strict=True)
    found += [replace(r, plates=force.plates).with_findings(*force.findings) for r, force in pairs]
    if not found:
        raise LogError(
            "no trial with markers and forces", remedy="give C3D files, or TRC and MOT files together"
        )
    order = {path: i for i, path in enumerate(trials)}
    return tuple(sorted(found, key=lambda r: order[r.source])), tuple(standing)
