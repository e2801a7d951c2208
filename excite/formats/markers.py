"""Files of motion laboratories: TRC with markers (Motion Analysis), MOT and STO with columns (OpenSim), C3D."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.child import in_child
from excite.formats.file import MAX_TEXT_BYTES, check_unique, read_bytes, read_text, unreadable
from excite.formats.tables import numbers_of_words, read_table

_END = "endheader"


@dataclass(frozen=True, eq=False)
class Trc:
    """What a TRC file holds.

    Attributes:
        unit: of length, as the file says it.
        time: ``(n,)`` [s].
        labels: of the markers.
        points: ``(n, n_markers, 3)`` in that unit; NaN where a marker was not seen.
    """

    unit: str
    time: NDArray[Any]
    labels: tuple[str, ...]
    points: NDArray[Any]


def read_trc(path: Path) -> Trc:
    """Header of five lines, then frame, time and three coordinates a marker between tabs; raises InputError."""
    lines = read_text(path, limit=MAX_TEXT_BYTES).splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError("is no TRC file", source=path, remedy="export the markers as TRC")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = {key.strip(): value for key, value in zip(keys, values, strict=False)}
    if "Units" not in header:
        raise InputError("is missing", source=path, field="Units", remedy="export the markers as TRC")
    labels = [label.strip() for label in lines[3].split("\t")[2:] if label.strip()]
    if not labels:
        raise InputError("names no markers", source=path, remedy="export it again")
    check_unique(labels, path)
    width = 2 + 3 * len(labels)
    rows = []
    for place, line in enumerate(lines[4:], start=5):
        fields = line.split("\t")
        if not fields[0].strip() or fields[0].strip().startswith("X"):
            continue
        # Programs leave out fields at the end of a line where the last markers were not seen.
        if len(fields) > width + 1 and any(field.strip() for field in fields[width:]):
            text = f"line {place} has {len(fields)} fields for {len(labels)} markers"
            raise InputError(text, source=path, remedy="export it again")
        fields = (fields + [""] * width)[:width]
        try:
            rows.append([float(text) if text.strip() else np.nan for text in fields])
        except ValueError as reason:
            text = f"line {place} is not numeric ({' '.join(str(reason).split())[:80]})"
            raise InputError(text, source=path, remedy="write numbers only") from reason
    if not rows:
        raise InputError("holds no frames", source=path, remedy="export it again")
    data = np.array(rows)
    points = data[:, 2:].reshape(len(data), len(labels), 3)
    # Programs write a marker that was not seen as empty fields or as exact zeros.
    points[(points == 0.0).all(axis=2)] = np.nan
    return Trc(header["Units"], data[:, 1], tuple(labels), points)


def read_storage(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of a MOT or STO file by label, ``(n,)`` each, as they stand in it.

    Raises:
        InputError: the header has no end, or a row is malformed.
    """
    table = read_table(path, below=_END)
    columns = {
        name: numbers_of_words(values, name, path, table.dress.skip) for name, values in table.columns.items()
    }
    if "time" not in columns or not len(columns["time"]):
        raise InputError("has no column time", source=path, remedy="export it again")
    return columns


# An hour of a hundred markers and four plates at usual rates has 400 MB.
MAX_C3D_BYTES = 512 * 1024 * 1024


@dataclass(frozen=True, eq=False)
class RawC3d:
    """What ezc3d reads, in the file's units.

    Attributes:
        rate_hz: of the frames [Hz].
        unit: of length.
        labels: of the points.
        points: ``(4, n_points, n)``.
        residuals: ``(n_points, n)``.
        plates: by plate, its force, moment, corners and units.
    """

    rate_hz: float
    unit: str
    labels: tuple[str, ...]
    points: NDArray[Any]
    residuals: NDArray[Any]
    plates: tuple[dict[str, Any], ...]


def read_c3d(path: Path) -> RawC3d:
    """Read a file; raises InputError with the field where its blocks or counts contradict its size."""
    content = read_bytes(path, limit=MAX_C3D_BYTES)
    header = check_c3d(content, path)
    # An interpreter starts in a second or two; files of 100 MB are read within a minute [s, bytes/s].
    # What libraries take at most, and what ezc3d makes of each byte of a file [GB, bytes].
    found: RawC3d = in_child(
        f"{__name__}:read_raw",
        path,
        source=path,
        seconds=20.0 + len(content) / 1e6,
        memory_gb=3.0 + 40.0 * len(content) / 1e9,
    )
    _, points, frames = found.points.shape
    if points != header.points:
        what = f"is {points}, and {header.points} in the header"
        raise InputError(what, source=path, field="POINT:USED", remedy=_DAMAGED)
    _check_room(frames, header, len(content), path)
    return found


def read_raw(path: Path) -> RawC3d:
    """Read a file with ezc3d, in this process; raises InputError."""
    import ezc3d

    with unreadable(path, remedy="export it again"):
        content = ezc3d.c3d(str(path), extract_forceplat_data=True)
        point = content["parameters"]["POINT"]
        units = point.get("UNITS", {}).get("value") or ["mm"]
        # Names of the points; a list holds 255 of them, others follow in LABELS2, LABELS3, …
        found: list[str] = []
        names = ["LABELS", *(f"LABELS{i}" for i in range(2, 256))]
        for name in names:
            if name not in point:
                break
            found += [str(label).strip() for label in point[name]["value"]]
        return RawC3d(
            rate_hz=float(content["header"]["points"]["frame_rate"]),
            unit=str(units[0]),
            labels=tuple(found),
            points=np.asarray(content["data"]["points"], dtype=float),
            residuals=np.asarray(content["data"]["meta_points"]["residuals"], dtype=float)[0],
            plates=tuple(_raw_plate(plate) for plate in content["data"].get("platform", ())),
        )


def _raw_plate(plate: Any) -> dict[str, Any]:
    values = {name: np.asarray(plate[name], dtype=float) for name in ("force", "moment", "corners")}
    return values | {name: str(plate.get(name, "")) for name in ("unit_moment", "unit_position")}


# Whether a C3D file has room for what it says it holds, before a library believes it (c3d.org, user guide
# 2021).

BLOCK = 512
_INTEL, _DEC, _MIPS = 84, 85, 86
# The largest known body has some hundred markers with clouds of some thousand.
_MOST_POINTS = 20_000
_DAMAGED = "it is damaged: export it again"


@dataclass(frozen=True)
class _Header:
    """The first block.

    Attributes:
        parameters: first block of the parameters, from 1.
        points: number of points.
        analog: analog numbers in each frame.
        frames: number of frames.
        size: of a number in the data [bytes].
        data: first block of the data, from 1.
        rate_hz: of the frames [Hz].
    """

    parameters: int
    points: int
    analog: int
    frames: int
    size: int
    data: int
    rate_hz: float


def check_c3d(content: bytes, path: Path) -> _Header:
    """The header of a file whose blocks and counts its size allows; raises InputError with the field."""
    header = _read_header(content, path)
    blocks = len(content) // BLOCK
    faults = {
        "parameter block": not 2 <= header.parameters <= blocks + 1
        and f"is number {header.parameters} of {blocks}",
        "data block": not 2 <= header.data <= blocks + 1 and f"is number {header.data} of {blocks}",
        "number of points": header.points > _MOST_POINTS and f"is {header.points}",
        "frame rate": not 0.0 < header.rate_hz <= 1e6 and f"is {header.rate_hz:g} Hz",
    }
    for field, what in faults.items():
        if what:
            raise InputError(what, source=path, field=field, remedy=_DAMAGED)
    # A count of frames that does not fit into the header is this much there, and right in the parameters.
    _check_room(header.frames if header.frames < 0xFFFF else 1, header, len(content), path)
    return header


def _check_room(frames: int, header: _Header, size: int, path: Path) -> None:
    """Raise InputError where the file has no room for so many frames."""
    frame, room = (4 * header.points + header.analog) * header.size, size - (header.data - 1) * BLOCK
    if frames < 1 or frames * frame > room:
        what = f"says {frames} frames, and there is room for {room // frame if frame else 0}"
        raise InputError(
            what, source=path, field="frames", remedy="it is cut off or damaged: export it again"
        )


def _read_header(content: bytes, path: Path) -> _Header:
    if len(content) < 2 * BLOCK or content[1] != 0x50:
        raise InputError("is no C3D file", source=path, remedy="export it again")
    start = (content[0] - 1) * BLOCK
    processor = content[start + 3] if 0 <= start < len(content) - 3 else 0
    if processor not in {_INTEL, _DEC, _MIPS}:
        what = f"is {processor}, none of {_INTEL}, {_DEC} and {_MIPS}"
        raise InputError(what, source=path, field="processor", remedy=_DAMAGED)
    order = ">" if processor == _MIPS else "<"
    points, analog, first, last = struct.unpack_from(f"{order}4H", content, 2)
    (data,) = struct.unpack_from(f"{order}H", content, 16)
    reals = [content[at : at + 4] for at in (12, 20)]
    if processor == _DEC:
        # Words are exchanged, and exponents two higher.
        reals = [raw[2:] + raw[:2] for raw in reals]
    scale, rate = (struct.unpack(f"{order}f", raw)[0] for raw in reals)
    rate = rate / 4.0 if processor == _DEC else rate
    size = 4 if scale < 0.0 else 2
    return _Header(content[0], points, analog, last - first + 1, size, data, rate)
