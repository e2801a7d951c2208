"""C3D files: markers and force plates of one trial."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.formats.child import in_child
from excite.formats.file import read_bytes
from excite.human.readers.c3d_raw import RawC3d
from excite.human.readers.reader import RecordingReader, metres_per_unit
from excite.human.recording import PlateRecording, Recording

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


# Whether a C3D file has room for what it says it holds, before a library believes it (c3d.org, user guide
# 2021).

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


# Bounds of what a motion laboratory can have measured, whatever the format.

# Markers are a few metres from the origin, and in a file of millimetres that claims metres some thousands [m].
_FARTHEST = 1e6
# A jump has ten times a person's weight; a moment about the origin may be in N·mm [N, N·m].
_LARGEST_FORCE, _LARGEST_MOMENT = 1e6, 1e9
_MOST_MARKERS = 20_000
# Cameras of motion laboratories take 30 to 1000 frames a second [Hz].
_SLOWEST_HZ, _FASTEST_HZ = 5.0, 1e5
# Frames come at one rate: a longer step is a frame that is not there.
_LONGEST_STEP = 1.5
_PLAUSIBLE_REMEDY = "export it again"


def check_recording(recording: Recording) -> Recording:
    """The recording, if markers and plates are within bounds; raises LogError that names the channel."""
    path = recording.source
    if len(recording.markers) > _MOST_MARKERS:
        raise LogError(f"has {len(recording.markers)} markers", source=path, remedy=_PLAUSIBLE_REMEDY)
    if recording.markers:
        _check_frames(recording.time, path)
    for label, values in recording.markers.items():
        largest = np.abs(values, where=~np.isnan(values), out=np.zeros_like(values)).max(initial=0.0)
        if not largest <= _FARTHEST:
            raise LogError(
                f"lies {largest:.3g} m away", source=path, field=label[:60], remedy=_PLAUSIBLE_REMEDY
            )
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
                remedy=_PLAUSIBLE_REMEDY,
            )
