"""C3D files byte by byte, as programs of the field write them, independent of the library that reads them.

Written from the format's own description (c3d.org, "The C3D File Format: User Guide", 2021): header, parameters and
data in blocks of 512 bytes; real or integer data; Intel's or DEC's floating point; labels beyond 255 in LABELS2.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

BLOCK = 512
INTEL, DEC = 84, 85


@dataclass(frozen=True)
class Style:
    """How a program writes.

    Attributes:
        processor: 84 Intel, 85 DEC.
        integers: whether points and analog samples are 16-bit integers.
        unit: of length, and what one metre is in it.
        moment_unit: of the plates' moments, None leaves the analog channels' units out.
        prefix: before each label.
        extra: unnamed trajectories before the first label, which push labels into LABELS2.
        first_frame: number of the first frame.
    """

    processor: int = INTEL
    integers: bool = False
    unit: tuple[str, float] = ("mm", 1000.0)
    moment_unit: str | None = "Nmm"
    prefix: str = ""
    extra: int = 0
    first_frame: int = 1


@dataclass(frozen=True, eq=False)
class Plate:
    """Channels of a force plate in the file's units.

    Attributes:
        kind: 2, 3 or 4.
        channels: ``(n, 6)`` or ``(n, 8)``.
        corners: ``(4, 3)``.
        origin: ``(3,)``.
        calibration: ``(6, 6)`` of type 4.
    """

    kind: int
    channels: np.ndarray
    corners: np.ndarray
    origin: np.ndarray
    calibration: np.ndarray = field(default_factory=lambda: np.eye(6))


def real(value: float, processor: int) -> bytes:
    """A 32-bit number as the processor has it: DEC's exponent counts two higher, its words are exchanged."""
    if processor == INTEL:
        return struct.pack("<f", value)
    # DEC has no minus zero.
    raw = struct.pack("<f", 4.0 * value + 0.0)
    return raw[2:] + raw[:2]


def write(
    path: Path,
    markers: dict[str, np.ndarray],
    rate_hz: float,
    plates: list[Plate],
    style: Style,
    per_frame: int = 10,
) -> Path:
    """Write markers [m] (NaN where they are missing) and plates."""
    scale_to = style.unit[1]
    labels = [f"*{i}" for i in range(style.extra)] + [style.prefix + label for label in markers]
    n = len(next(iter(markers.values())))
    points = np.zeros((n, len(labels), 4))
    points[:, : style.extra, 3] = -1.0
    stacked = np.stack(list(markers.values()), axis=1) * scale_to
    missing = ~np.isfinite(stacked).all(axis=2)
    points[:, style.extra :, :3] = np.where(missing[..., None], 0.0, stacked)
    points[:, style.extra :, 3] = np.where(missing, -1.0, 0.0)
    channels = [column for plate in plates for column in plate.channels.T]
    analog = np.column_stack(channels)[: n * per_frame] if channels else np.zeros((n * per_frame, 0))
    point_scale = float(np.abs(points[..., :3]).max()) / 32000.0
    scales = np.maximum(np.abs(analog).max(axis=0), 1e-9) / 32000.0 if channels else np.zeros(0)
    if not style.integers:
        scales = np.ones(len(channels))
    parameters = _parameters(labels, n, rate_hz, per_frame, plates, scales, point_scale, style)
    start = 2 + len(parameters) // BLOCK
    header = struct.pack(
        "<BBHHHHH", 2, 0x50, len(labels), len(channels) * per_frame, style.first_frame,
        style.first_frame + n - 1, 10,
    )  # fmt: skip
    header += real(point_scale if style.integers else -point_scale, style.processor)
    header += struct.pack("<HH", start, per_frame) + real(rate_hz, style.processor)
    body = bytearray()
    for i in range(n):
        samples = analog[i * per_frame : (i + 1) * per_frame] / scales
        if style.integers:
            frame = points[i].copy()
            frame[:, :3] /= point_scale
            body += np.round(frame).astype("<i2").tobytes() + np.round(samples).astype("<i2").tobytes()
        else:
            body += b"".join(real(v, style.processor) for v in (*points[i].ravel(), *samples.ravel()))
    content = header.ljust(BLOCK, b"\0") + parameters + bytes(body)
    path.write_bytes(content + b"\0" * (-len(content) % BLOCK))
    return path


def _parameters(labels, n, rate_hz, per_frame, plates, scales, point_scale, style) -> bytes:
    kinds = [plate.kind for plate in plates]
    width = max((plate.channels.shape[1] for plate in plates), default=6)
    numbers = np.zeros((len(plates), width), dtype=int)
    names, units, used = [], [], 0
    for i, plate in enumerate(plates):
        size = plate.channels.shape[1]
        numbers[i, :size] = np.arange(used + 1, used + size + 1)
        used += size
        names += [f"p{i + 1}_{k}" for k in range(size)]
        units += ["N"] * (3 if size == 6 else 8) + [style.moment_unit or ""] * (3 if size == 6 else 0)
    groups: dict[str, dict[str, object]] = {
        "POINT": {
            "USED": np.array([len(labels)]),
            "SCALE": np.array([point_scale if style.integers else -point_scale]),
            "RATE": np.array([rate_hz]),
            "FRAMES": np.array([min(n, 32767)]),
            "UNITS": [style.unit[0]],
            **{f"LABELS{k // 255 + 1 if k else ''}": labels[k : k + 255] for k in range(0, len(labels), 255)},
        },
        "ANALOG": {
            "USED": np.array([used]),
            "RATE": np.array([rate_hz * per_frame]),
            "GEN_SCALE": np.array([1.0]),
            "SCALE": np.asarray(scales, dtype=float),
            "OFFSET": np.zeros(used, dtype=int),
            "LABELS": names,
            **({} if style.moment_unit is None else {"UNITS": units}),
        },
        "FORCE_PLATFORM": {
            "USED": np.array([len(plates)]),
            "TYPE": np.array(kinds, dtype=int),
            "ZERO": np.array([1, 0]),
            "CORNERS": np.array([plate.corners for plate in plates], dtype=float),
            "ORIGIN": np.array([plate.origin for plate in plates], dtype=float),
            "CHANNEL": numbers,
        },
    }
    if 4 in kinds:
        matrices = np.array([plate.calibration.T for plate in plates], dtype=float)
        groups["FORCE_PLATFORM"]["CAL_MATRIX"] = matrices
    found = b""
    for number, (group, entries) in enumerate(groups.items(), start=1):
        found += struct.pack("<bb", len(group), -number) + group.encode() + struct.pack("<HB", 3, 0)
        for name, value in entries.items():
            data = _value(value, style.processor) + b"\0"
            found += struct.pack("<bb", len(name), number) + name.encode()
            found += struct.pack("<H", 2 + len(data)) + data
    found += b"\0\0"
    blocks = -(-(len(found) + 4) // BLOCK)
    return (struct.pack("<BBBB", 1, 0x50, blocks, style.processor) + found).ljust(blocks * BLOCK, b"\0")


def _value(value: object, processor: int) -> bytes:
    """Type, dimensions (fastest first) and data."""
    if isinstance(value, list):
        length = max(len(text) for text in value)
        data = b"".join(text.ljust(length).encode() for text in value)
        return struct.pack("<bBBB", -1, 2, length, len(value)) + data
    array = np.asarray(value)
    shape = struct.pack(f"<B{array.ndim}B", array.ndim, *array.shape[::-1])
    if array.dtype.kind == "i":
        return struct.pack("<b", 2) + shape + array.astype("<i2").tobytes()
    return struct.pack("<b", 4) + shape + b"".join(real(float(v), processor) for v in array.ravel())


def plate_of(kind: int, corners: np.ndarray, depth: float, force: np.ndarray, moment: np.ndarray) -> Plate:
    """Channels of a plate that exerts a force and a moment about the laboratory's origin, in the file's units.

    The plate's z points down, x and y along its edges (corner 1 at +x +y, then -x +y, -x -y, +x -y); its sensors lie
    ``depth`` below the surface.
    """
    center = corners.mean(axis=0)
    x = corners[0] - corners[1]
    y = corners[0] - corners[3]
    axes = np.column_stack([x / np.linalg.norm(x), y / np.linalg.norm(y), [0.0, 0.0, -1.0]])
    f = force @ axes
    origin = np.array([0.0, 0.0, -depth])
    m = (moment - np.cross(center, force)) @ axes - np.cross(f, origin)
    if kind in (2, 4):
        calibration = np.eye(6)
        if kind == 4:
            calibration = np.eye(6) + 0.02 * np.random.default_rng(0).standard_normal((6, 6))
        channels = np.hstack([f, m]) @ np.linalg.inv(calibration).T
        return Plate(kind, channels, corners, origin, calibration)
    a, b = 0.4 * np.linalg.norm(x), 0.4 * np.linalg.norm(y)
    fz = [
        0.25 * (f[:, 2] + sx * m[:, 0] / b + sy * m[:, 1] / a)
        for sx, sy in ((1, -1), (1, 1), (-1, 1), (-1, -1))
    ]
    half = 0.5 * m[:, 2] / a
    channels = [0.5 * f[:, 0], 0.5 * f[:, 0], 0.5 * f[:, 1] + half, 0.5 * f[:, 1] - half, *fz]
    return Plate(kind, np.column_stack(channels), corners, np.array([a, b, -depth]))
