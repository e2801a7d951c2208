"""C3D files: markers and force plates of one trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import LogError
from excite.human.readers.reader import RecordingReader, metres_per_unit
from excite.human.recording import PlateRecording, Recording


class C3dReader(RecordingReader):
    """Read by ezc3d, which turns the channels of plates of types 1 to 7 to force and moment in the laboratory."""

    name: ClassVar[str] = "c3d"
    suffixes: ClassVar[tuple[str, ...]] = (".c3d",)

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        if not path.is_file():
            raise LogError("no such file", source=path, remedy="check the path")
        import ezc3d

        try:
            content = ezc3d.c3d(str(path), extract_forceplat_data=True)
        except (OSError, RuntimeError, ValueError, IndexError) as error:
            line = " ".join(str(error).split())
            raise LogError(f"cannot be read ({line})", source=path, remedy="export it again") from error
        point = content["parameters"]["POINT"]
        rate = float(content["header"]["points"]["frame_rate"])
        labels = _labels(point)
        data = np.asarray(content["data"]["points"], dtype=float)
        n = data.shape[2]
        if n < 2 or rate <= 0.0:
            raise LogError(f"has {n} frames at {rate:g} Hz", source=path, remedy="record longer")
        units = point.get("UNITS", {}).get("value") or ["mm"]
        unit = metres_per_unit(str(units[0]), path)
        position = data[:3].transpose(2, 1, 0) * unit
        missing = ~np.isfinite(position).all(axis=2) | (position == 0.0).all(axis=2)
        residuals = np.asarray(content["data"]["meta_points"]["residuals"])[0].T
        missing |= residuals < 0.0
        position[missing] = np.nan
        time = np.arange(n) / rate
        markers = {label: position[:, i] for i, label in enumerate(labels) if i < position.shape[1]}
        plates = tuple(
            _plate(plate, i, unit, time, path) for i, plate in enumerate(content["data"].get("platform", ()))
        )
        return Recording(path, time, markers, plates)


def _labels(point: Any) -> list[str]:
    """Names of the points; a list holds 255 of them, others follow in LABELS2, LABELS3, …"""
    found: list[str] = []
    names = ["LABELS", *(f"LABELS{i}" for i in range(2, 256))]
    for name in names:
        if name not in point:
            break
        found += [str(label).strip() for label in point[name]["value"]]
    return found


def _plate(plate: Any, index: int, length: float, time: np.ndarray, path: Path) -> PlateRecording:
    """Force and moment of a plate on the person, about the laboratory's origin.

    ezc3d gives moments about the centre of the surface; both come as the plate's reaction.
    """
    moment_unit = {"Nmm": 1e-3, "Nm": 1.0, "N.m": 1.0, "Ncm": 1e-2}
    unit = str(plate.get("unit_moment", "Nmm"))
    if unit not in moment_unit:
        raise LogError(
            f"is {unit!r}", source=path, field=f"plate {index + 1}, moment", remedy="use Nmm or Nm"
        )
    force = np.asarray(plate["force"], dtype=float).T
    about_center = np.asarray(plate["moment"], dtype=float).T * moment_unit[unit]
    place = str(plate.get("unit_position", ""))
    corners = np.asarray(plate["corners"], dtype=float).T * (
        metres_per_unit(place, path) if place else length
    )
    force, about_center = np.nan_to_num(force), np.nan_to_num(about_center)
    moment = about_center + np.cross(corners.mean(axis=0), force)
    at = np.arange(len(force)) * (time[1] - time[0]) * len(time) / max(len(force), 1)
    return PlateRecording(f"plate_{index + 1}", at, force, moment, corners)
