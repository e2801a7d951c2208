"""Bounds of what a motion laboratory can have measured, whatever the format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.human.recording import PlateRecording, Recording

# Markers are a few metres from the origin, and in a file of millimetres that claims metres some thousands [m].
_FARTHEST = 1e6
# A jump has ten times a person's weight; a moment about the origin may be in N·mm [N, N·m].
_LARGEST_FORCE, _LARGEST_MOMENT = 1e6, 1e9
_MOST_MARKERS = 20_000
# Cameras of motion laboratories take 30 to 1000 frames a second [Hz].
_SLOWEST_HZ, _FASTEST_HZ = 5.0, 1e5
# Frames come at one rate: a longer step is a frame that is not there.
_LONGEST_STEP = 1.5
_REMEDY = "export it again"


def check_recording(recording: Recording) -> Recording:
    """The recording, if markers and plates are within bounds; raises LogError that names the channel."""
    path = recording.source
    if len(recording.markers) > _MOST_MARKERS:
        raise LogError(f"has {len(recording.markers)} markers", source=path, remedy=_REMEDY)
    if recording.markers:
        _check_frames(recording.time, path)
    for label, values in recording.markers.items():
        largest = np.abs(values, where=~np.isnan(values), out=np.zeros_like(values)).max(initial=0.0)
        if not largest <= _FARTHEST:
            raise LogError(f"lies {largest:.3g} m away", source=path, field=label[:60], remedy=_REMEDY)
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
                remedy=_REMEDY,
            )
