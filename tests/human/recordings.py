"""Writes recordings as C3D files, in the format's own words."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.human.recording import Recording


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
