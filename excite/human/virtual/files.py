"""Recordings of markers and forces as OpenSim's files: TRC and MOT, in the formats' own words."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.atomic import atomic_path
from excite.human.recording import Recording


def write_trc(recording: Recording, path: Path, unit: float = 1e-3, name: str = "mm") -> Path:
    """A TRC file with y up; ``name`` is the unit that its header claims, ``unit`` the one it has."""
    labels = list(recording.markers)
    points = np.stack(list(recording.markers.values()), axis=1)
    turned = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) / unit
    rate = recording.rate_hz
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:g}\t{rate:g}\t{len(points)}\t{len(labels)}\t{name}\t{rate:g}\t1\t{len(points)}",
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(labels) + 1)),
        "",
    ]
    for i, (t, frame) in enumerate(zip(recording.time, turned, strict=True)):
        fields = [f"{v:.5f}" if np.isfinite(v) else "" for v in frame.ravel()]
        lines.append("\t".join([f"{i + 1}", f"{t:.5f}", *fields]))
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_mot(
    recording: Recording, path: Path, names: tuple[str, ...] = ("R", "L"), point_unit: float = 1.0
) -> Path:
    """Ground reaction forces with y up, point of application on the floor and free moment."""
    columns = {"time": recording.plates[0].time}
    for name, plate in zip(names, recording.plates, strict=True):
        loaded = np.abs(plate.force[:, 2]) > 5.0
        vertical = np.where(loaded, plate.force[:, 2], 1.0)
        point = np.column_stack([-plate.moment[:, 1] / vertical, plate.moment[:, 0] / vertical, 0 * vertical])
        point[~loaded] = 0.0
        free = plate.moment - np.cross(point, plate.force)
        for kind, values in (("force_v", plate.force), ("force_p", point / point_unit), ("torque_", free)):
            turned = np.column_stack([values[:, 0], values[:, 2], -values[:, 1]])
            for axis, column in zip("xyz", turned.T, strict=True):
                columns[f"{name}_ground_{kind}{axis}"] = column
    lines = ["forces", f"nRows={len(columns['time'])}", "endheader", "\t".join(columns)]
    lines += ["\t".join(f"{v:.6f}" for v in row) for row in np.column_stack(list(columns.values()))]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
