"""C3D files: markers and force plates of one trial."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.formats.c3d import read_c3d
from excite.human.readers.reader import RecordingReader, metres_per_unit
from excite.human.recording import PlateRecording, Recording


class C3dReader(RecordingReader):
    """Read by ezc3d, which turns the channels of plates of types 1 to 7 to force and moment in the laboratory.

    Damaged files make it crash, hang or ask for all memory: what a file says of itself is looked at first, and ezc3d
    runs in a process of its own.
    """

    name: ClassVar[str] = "c3d"
    suffixes: ClassVar[tuple[str, ...]] = (".c3d",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
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
