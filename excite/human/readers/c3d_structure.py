"""Whether a C3D file has room for what it says it holds, before a library believes it (c3d.org, user guide 2021)."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from excite.errors import LogError

BLOCK = 512
_MAGIC = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86
# A count of frames that does not fit into the header is this much there, and right in the parameters.
_FULL = 0xFFFF
# Sizes of a value by its type: characters, bytes, 16-bit integers, reals.
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}
# The largest known laboratory has 32 plates, a full body some hundred markers with clouds of some thousand.
_MOST_PLATES, _MOST_POINTS = 255, 20_000
_REMEDY = "it is damaged: export it again"


@dataclass(frozen=True)
class C3dHeader:
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


def check_c3d(content: bytes, path: Path) -> None:
    """Refuse a file whose blocks, records or counts contradict its size; raises LogError with the field."""
    header = _read_header(content, path)
    for field, block in (("parameter block", header.parameters), ("data block", header.data)):
        if not 2 <= block <= len(content) // BLOCK + 1:
            raise LogError(
                f"is number {block} of {len(content) // BLOCK}", source=path, field=field, remedy=_REMEDY
            )
    if header.points > _MOST_POINTS:
        raise LogError(f"is {header.points}", source=path, field="number of points", remedy=_REMEDY)
    if not (math.isfinite(header.rate_hz) and 0.0 < header.rate_hz <= 1e6):
        raise LogError(f"is {header.rate_hz:g} Hz", source=path, field="frame rate", remedy=_REMEDY)
    frame = (4 * header.points + header.analog) * header.size
    room = len(content) - (header.data - 1) * BLOCK
    if header.frames < 1 or (header.frames < _FULL and header.frames * frame > room):
        held = room // frame if frame else 0
        raise LogError(
            f"says {header.frames} frames, and there is room for {held}",
            source=path,
            field="frames",
            remedy="it is cut off or damaged: export it again",
        )
    _check_counts(dict(_read_records(content, header, path)), header, frame, room, path)


def _read_header(content: bytes, path: Path) -> C3dHeader:
    if len(content) < 2 * BLOCK or content[1] != _MAGIC:
        raise LogError("is no C3D file", source=path, remedy="export it again")
    start = (content[0] - 1) * BLOCK
    processor = content[start + 3] if 0 <= start < len(content) - 3 else 0
    if processor not in {_INTEL, _DEC, _MIPS}:
        raise LogError(
            f"is {processor}, none of {_INTEL}, {_DEC} and {_MIPS}",
            source=path,
            field="processor",
            remedy=_REMEDY,
        )
    order = ">" if processor == _MIPS else "<"
    points, analog, first, last = struct.unpack(f"{order}4H", content[2:10])
    data = struct.unpack(f"{order}H", content[16:18])[0]
    scale, rate = (_read_real(content[at : at + 4], processor) for at in (12, 20))
    size = 4 if scale < 0.0 else 2
    return C3dHeader(content[0], points, analog, last - first + 1, size, data, rate, order)


def _read_real(raw: bytes, processor: int) -> float:
    if processor == _DEC:
        return float(struct.unpack("<f", raw[2:] + raw[:2])[0]) / 4.0
    return float(struct.unpack(">f" if processor == _MIPS else "<f", raw)[0])


def _read_records(content: bytes, header: C3dHeader, path: Path) -> Iterator[tuple[tuple[int, str], bytes]]:
    """Parameters by number of their group and name, with their data; the groups' names under an empty one."""
    place = (header.parameters - 1) * BLOCK + 4
    end = (header.data - 1) * BLOCK if header.data > header.parameters else len(content)
    while place + 2 <= end:
        length, number = abs(struct.unpack("b", content[place : place + 1])[0]), content[place + 1]
        if length == 0 or number == 0:
            return
        after = place + 2 + length
        name = content[place + 2 : after].decode("latin-1").strip().upper()
        if after + 2 > end:
            raise _outside_error(name, path)
        offset = struct.unpack(f"{header.order}H", content[after : after + 2])[0]
        following = after + offset if offset else end
        if following > end or offset == 1:
            raise _outside_error(name, path)
        if number >= 128:
            yield (256 - number, ""), name.encode("latin-1")
        else:
            yield (number, name), _record_data(content[after + 2 : following], name, path)
        if offset == 0:
            return
        place = following


def _record_data(record: bytes, name: str, path: Path) -> bytes:
    """The values of a parameter, as large as its dimensions say."""
    kind = struct.unpack("b", record[:1])[0] if record else 0
    count = record[1] if len(record) > 1 else 255
    if kind not in _SIZES or count > 7 or len(record) < 2 + count:
        raise _outside_error(name, path)
    size = _SIZES[kind] * math.prod(record[2 : 2 + count])
    if len(record) < 2 + count + size:
        raise _outside_error(name, path)
    return record[2 + count : 2 + count + size]


def _outside_error(name: str, path: Path) -> LogError:
    shown = "".join(c for c in name if c.isprintable())[:30]
    return LogError(
        "does not fit into the file", source=path, field=f"parameter {shown}".strip(), remedy=_REMEDY
    )


def _check_counts(
    records: dict[tuple[int, str], bytes], header: C3dHeader, frame: int, room: int, path: Path
) -> None:
    """Counts that stand in the parameters too, against those of the header and the file's size."""
    groups = {name.decode("latin-1"): number for (number, key), name in records.items() if not key}

    def integer(group: str, name: str) -> int | None:
        data = records.get((groups.get(group, 0), name), b"")
        return struct.unpack(f"{header.order}H", data)[0] if len(data) == 2 else None

    used = integer("POINT", "USED")
    if used is not None and used != header.points:
        raise LogError(
            f"is {used}, and {header.points} in the header", source=path, field="POINT:USED", remedy=_REMEDY
        )
    frames = integer("POINT", "FRAMES")
    if header.frames >= _FULL and frames is not None and frames * frame > room:
        raise LogError(
            f"is {frames}, and there is room for {room // frame}",
            source=path,
            field="POINT:FRAMES",
            remedy="it is cut off or damaged: export it again",
        )
    plates = integer("FORCE_PLATFORM", "USED")
    if plates is not None and plates > _MOST_PLATES:
        raise LogError(f"is {plates}", source=path, field="FORCE_PLATFORM:USED", remedy=_REMEDY)
