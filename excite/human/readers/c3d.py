"""C3D files: markers and force plates of one trial."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import LogError
from excite.human.readers.c3d_raw import RawC3d
from excite.human.readers.c3d_structure import check_c3d
from excite.human.readers.reader import RecordingReader, metres_per_unit
from excite.human.recording import PlateRecording, Recording
from excite.reading.child import in_child
from excite.reading.file import read_bytes

# An hour of a hundred markers and four plates at usual rates has 400 MB.
MAX_C3D_BYTES = 512 * 1024 * 1024
# An interpreter starts in a second or two; files of 100 MB are read within a minute [s, bytes/s].
_STARTING_S, _BYTES_PER_S = 20.0, 1e6
# What libraries take at most, and what ezc3d makes of each byte of a file [GB, bytes].
_LIBRARIES_GB, _BYTES_PER_BYTE = 3.0, 40.0


class C3dReader(RecordingReader):
    """Read by ezc3d, which turns the channels of plates of types 1 to 7 to force and moment in the laboratory.

    Damaged files make it crash, hang or ask for all memory: what a file says of itself is looked at first, and ezc3d
    runs in a process of its own.
    """

    name: ClassVar[str] = "c3d"
    suffixes: ClassVar[tuple[str, ...]] = (".c3d",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        content = read_bytes(path, limit=MAX_C3D_BYTES, error=LogError)
        check_c3d(content, path)
        raw: RawC3d = in_child(
            "excite.human.readers.c3d_raw:read_raw",
            path,
            source=path,
            error=LogError,
            seconds=_STARTING_S + len(content) / _BYTES_PER_S,
            memory_gb=_LIBRARIES_GB + _BYTES_PER_BYTE * len(content) / 1e9,
        )
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
