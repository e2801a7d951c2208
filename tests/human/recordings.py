"""Writes recordings as files, in the formats' own words."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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
    path.write_text("\n".join(lines) + "\n")
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
    path.write_text("\n".join(lines) + "\n")
    return path


def write_c3d(recording: Recording, path: Path, swap: bool = False) -> Path:
    """A C3D file in millimetres with plates of type 2; ``swap`` exchanges the plates' channels."""
    import ezc3d

    content = ezc3d.c3d()
    labels = list(recording.markers)
    points = np.stack(list(recording.markers.values()), axis=1) * 1e3
    parameters = content["parameters"]
    parameters["POINT"]["RATE"]["value"] = [recording.rate_hz]
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["POINT"]["LABELS"]["value"] = labels
    data = np.ones((4, len(labels), len(points)))
    data[:3] = points.transpose(2, 1, 0)
    content["data"]["points"] = data
    plates = recording.plates
    n = 10 * len(points)
    channels, names, corners = [], [], []
    for i, plate in enumerate(plates):
        corner = plate.corners * 1e3
        x = corner[0] + corner[3] - corner[1] - corner[2]
        x = x / np.linalg.norm(x)
        turn = np.column_stack([x, np.cross([0, 0, 1.0], x), [0, 0, 1.0]])
        measured = plates[(i + 1) % len(plates)] if swap else plate
        moment = measured.moment - np.cross(measured.corners.mean(axis=0), measured.force)
        values = np.hstack([measured.force @ turn, 1e3 * moment @ turn])
        values = np.vstack([values[:n], np.repeat(values[-1:], max(0, n - len(values)), axis=0)])
        channels += list(values.T)
        names += [f"{axis}{i + 1}" for axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
        corners.append(corner.T)
    parameters["ANALOG"]["RATE"]["value"] = [10.0 * recording.rate_hz]
    parameters["ANALOG"]["LABELS"]["value"] = names
    content["data"]["analogs"] = np.array(channels)[None]
    k = len(plates)
    content.add_parameter("FORCE_PLATFORM", "USED", k)
    for name, values in {
        "TYPE": np.full(k, 2.0),
        "ZERO": np.array([1.0, 0.0]),
        "CHANNEL": np.arange(1.0, 6 * k + 1).reshape(k, 6).T,
    }.items():
        content.add_parameter("FORCE_PLATFORM", name, values)
        entry = parameters["FORCE_PLATFORM"][name]
        entry["type"], entry["value"] = 2, entry["value"].astype(int)
    content.add_parameter("FORCE_PLATFORM", "CORNERS", np.stack(corners, axis=-1))
    content.add_parameter("FORCE_PLATFORM", "ORIGIN", np.zeros((3, k)))
    content.write(str(path))
    return path
