"""MOT and STO files of OpenSim that hold ground reaction forces."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.human.readers.reader import RecordingReader, check_labels, checked_time, read_lines, row_numbers
from excite.human.recording import PlateRecording, Recording


class StorageReader(RecordingReader):
    """``NAME_vx … vz`` forces [N], ``NAME_px … pz`` points of application [m], torques ``…torque…x … z`` [N·m]."""

    name: ClassVar[str] = "mot"
    suffixes: ClassVar[tuple[str, ...]] = (".mot", ".sto")

    def read(self, path: Path) -> Recording:
        """See :meth:`RecordingReader.read`."""
        columns = read_storage(path)
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
                    name=_plate_name(stem, len(plates)),
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


def read_storage(path: Path) -> dict[str, Array]:
    """Columns of a MOT or STO file by label, ``(n,)`` each, as they stand in it.

    Raises:
        LogError: the header has no end, or a row is malformed.
    """
    lines = read_lines(path)
    ends = [i for i, line in enumerate(lines[:100]) if line.strip().lower() == "endheader"]
    if not ends or len(lines) < ends[0] + 3:
        raise LogError("has no endheader and rows below", source=path, remedy="export it from OpenSim again")
    labels = lines[ends[0] + 1].split()
    check_labels(labels, path)
    rows = []
    for place, line in enumerate(lines[ends[0] + 2 :], start=ends[0] + 3):
        fields = line.split()
        if not fields:
            continue
        if len(fields) != len(labels):
            raise LogError(
                f"line {place} has {len(fields)} numbers for {len(labels)} columns",
                source=path,
                remedy="export it again",
            )
        rows.append(row_numbers(fields, path, place))
    if "time" not in labels or not rows:
        raise LogError("has no column time", source=path, remedy="export it again")
    data = np.array(rows)
    return {label: data[:, i] for i, label in enumerate(labels)}


def _storage_vector(columns: dict[str, Array], stem: str, path: Path) -> Array:
    missing = [f"{stem}{axis}" for axis in "xyz" if f"{stem}{axis}" not in columns]
    if missing:
        raise LogError(
            "column is missing", source=path, field=missing[0], remedy="export all three components"
        )
    values = np.column_stack([columns[f"{stem}{axis}"] for axis in "xyz"])
    if not np.isfinite(values).all():
        raise LogError("is not finite", source=path, field=f"{stem}x", remedy="export it again")
    return values


def _stated_foot(stem: str) -> str | None:
    parts = re.split(r"[_.]", stem.lower())
    if {"r", "right"} & set(parts):
        return "right"
    return "left" if {"l", "left"} & set(parts) else None


def _plate_name(stem: str, index: int) -> str:
    foot = _stated_foot(stem)
    return f"plate_{foot}" if foot else f"plate_{index + 1}"
