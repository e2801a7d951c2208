"""C3D files: what a file says of itself is looked at first, then ezc3d reads it in a process of its own."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.child import in_child
from excite.formats.file import read_bytes, unreadable

# An hour of a hundred markers and four plates at usual rates has 400 MB.
MAX_C3D_BYTES = 512 * 1024 * 1024
# An interpreter starts in a second or two; files of 100 MB are read within a minute [s, bytes/s].
_STARTING_S, _BYTES_PER_S = 20.0, 1e6
# What libraries take at most, and what ezc3d makes of each byte of a file [GB, bytes].
_LIBRARIES_GB, _BYTES_PER_BYTE = 3.0, 40.0


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


def read_c3d(path: Path, error: type[InputError] = InputError) -> RawC3d:
    """Read a file; raises ``error`` with the field where its blocks, records or counts contradict its size."""
    content = read_bytes(path, limit=MAX_C3D_BYTES, error=error)
    check_c3d(content, path, error)
    found: RawC3d = in_child(
        f"{__name__}:read_raw",
        path,
        error,
        source=path,
        error=error,
        seconds=_STARTING_S + len(content) / _BYTES_PER_S,
        memory_gb=_LIBRARIES_GB + _BYTES_PER_BYTE * len(content) / 1e9,
    )
    return found


def read_raw(path: Path, error: type[InputError]) -> RawC3d:
    """Read a file with ezc3d, in this process; raises ``error``."""
    import ezc3d

    with unreadable(path, error, remedy="export it again"):
        content = ezc3d.c3d(str(path), extract_forceplat_data=True)
        point = content["parameters"]["POINT"]
        units = point.get("UNITS", {}).get("value") or ["mm"]
        return RawC3d(
            rate_hz=float(content["header"]["points"]["frame_rate"]),
            unit=str(units[0]),
            labels=tuple(_point_labels(point)),
            points=np.asarray(content["data"]["points"], dtype=float),
            residuals=np.asarray(content["data"]["meta_points"]["residuals"], dtype=float)[0],
            plates=tuple(_raw_plate(plate) for plate in content["data"].get("platform", ())),
        )


def _raw_plate(plate: Any) -> dict[str, Any]:
    values = {name: np.asarray(plate[name], dtype=float) for name in ("force", "moment", "corners")}
    return values | {name: str(plate.get(name, "")) for name in ("unit_moment", "unit_position")}


def _point_labels(point: Any) -> list[str]:
    """Names of the points; a list holds 255 of them, others follow in LABELS2, LABELS3, …"""
    found: list[str] = []
    names = ["LABELS", *(f"LABELS{i}" for i in range(2, 256))]
    for name in names:
        if name not in point:
            break
        found += [str(label).strip() for label in point[name]["value"]]
    return found


# Whether a C3D file has room for what it says it holds, before a library believes it (c3d.org, user guide
# 2021).

BLOCK = 512
_INTEL, _DEC, _MIPS = 84, 85, 86
# A count of frames that does not fit into the header is this much there, and right in the parameters.
_FULL = 0xFFFF
# Sizes of a value by its type: characters, bytes, 16-bit integers, reals.
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}
# The largest known laboratory has 32 plates, a full body some hundred markers with clouds of some thousand.
_MOST_PLATES, _MOST_POINTS = 255, 20_000
_CUT = "it is cut off or damaged: export it again"


class _Refused(Exception):
    """What is wrong with a field."""

    def __init__(self, what: str, field: str | None = None, remedy: str = "it is damaged: export it again"):
        super().__init__(what)
        self.what, self.field, self.remedy = what, field, remedy


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
        order: of the bytes, as struct names it.
    """

    parameters: int
    points: int
    analog: int
    frames: int
    size: int
    data: int
    rate_hz: float
    order: str


def check_c3d(content: bytes, path: Path, error: type[InputError] = InputError) -> None:
    """Refuse a file whose blocks, records or counts contradict its size; raises ``error`` with the field."""
    try:
        header = _read_header(content)
        blocks = len(content) // BLOCK
        for field, block in (("parameter block", header.parameters), ("data block", header.data)):
            if not 2 <= block <= blocks + 1:
                raise _Refused(f"is number {block} of {blocks}", field)
        if header.points > _MOST_POINTS:
            raise _Refused(f"is {header.points}", "number of points")
        if not (math.isfinite(header.rate_hz) and 0.0 < header.rate_hz <= 1e6):
            raise _Refused(f"is {header.rate_hz:g} Hz", "frame rate")
        _check_counts(_read_records(content, header), header, len(content) - (header.data - 1) * BLOCK)
    except _Refused as reason:
        raise error(reason.what, source=path, field=reason.field, remedy=reason.remedy) from None


def _read_header(content: bytes) -> _Header:
    if len(content) < 2 * BLOCK or content[1] != 0x50:
        raise _Refused("is no C3D file", remedy="export it again")
    start = (content[0] - 1) * BLOCK
    processor = content[start + 3] if 0 <= start < len(content) - 3 else 0
    if processor not in {_INTEL, _DEC, _MIPS}:
        raise _Refused(f"is {processor}, none of {_INTEL}, {_DEC} and {_MIPS}", "processor")
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
    return _Header(content[0], points, analog, last - first + 1, size, data, rate, order)


def _read_records(content: bytes, header: _Header) -> Iterator[tuple[tuple[int, str], bytes]]:
    """Parameters by number of their group and name, with their data; the groups' names under an empty one."""
    place = (header.parameters - 1) * BLOCK + 4
    end = (header.data - 1) * BLOCK if header.data > header.parameters else len(content)
    offset = 1
    while offset and place + 2 <= end:
        length, number = abs(struct.unpack_from("b", content, place)[0]), content[place + 1]
        if length == 0 or number == 0:
            return
        after = place + 2 + length
        name = content[place + 2 : after].decode("latin-1").strip().upper()
        shown = f"parameter {''.join(c for c in name if c.isprintable())[:30]}".strip()
        outside = _Refused("does not fit into the file", shown)
        if after + 2 > end:
            raise outside
        (offset,) = struct.unpack_from(f"{header.order}H", content, after)
        place = after + offset if offset else end
        if place > end or offset == 1:
            raise outside
        if number >= 128:
            yield (256 - number, ""), name.encode("latin-1")
            continue
        record = content[after + 2 : place]
        kind, count = struct.unpack_from("bB", record) if len(record) > 1 else (0, 255)
        size = _SIZES.get(kind, len(content)) * math.prod(record[2 : 2 + count])
        if count > 7 or len(record) < 2 + count + size:
            raise outside
        yield (number, name), record[2 + count : 2 + count + size]


def _check_counts(parameters: Iterator[tuple[tuple[int, str], bytes]], header: _Header, room: int) -> None:
    """Counts of the header and those that stand in the parameters too, against each other and the file's size."""
    frame, long = (4 * header.points + header.analog) * header.size, header.frames >= _FULL
    if header.frames < 1 or (not long and header.frames * frame > room):
        held = room // frame if frame else 0
        raise _Refused(f"says {header.frames} frames, and there is room for {held}", "frames", _CUT)
    records = dict(parameters)
    groups = {name.decode("latin-1"): number for (number, key), name in records.items() if not key}

    def read_integer(group: str, name: str) -> int:
        data = records.get((groups.get(group, 0), name), b"")
        return int(struct.unpack(f"{header.order}H", data)[0]) if len(data) == 2 else -1

    used, frames, plates = (
        read_integer(*place) for place in (("POINT", "USED"), ("POINT", "FRAMES"), ("FORCE_PLATFORM", "USED"))
    )
    if used not in (-1, header.points):
        raise _Refused(f"is {used}, and {header.points} in the header", "POINT:USED")
    if long and frames * frame > room:
        raise _Refused(f"is {frames}, and there is room for {room // frame}", "POINT:FRAMES", _CUT)
    if plates > _MOST_PLATES:
        raise _Refused(f"is {plates}", "FORCE_PLATFORM:USED")
