"""What ezc3d reads of a C3D file, as plain arrays that go from one process to another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.errors import LogError

if TYPE_CHECKING:
    # A process that reads one file shall not wait for the robots' library.
    from excite.arrays import Array


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
    points: Array
    residuals: Array
    plates: tuple[dict[str, Any], ...]


def read_raw(path: Path) -> RawC3d:
    """Read a file with ezc3d, in this process; raises LogError."""
    import ezc3d

    try:
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
    except (OSError, RuntimeError, ValueError, IndexError, KeyError, TypeError, MemoryError) as error:
        line = " ".join(str(error).split())[:160] or type(error).__name__
        raise LogError(f"cannot be read ({line})", source=path, remedy="export it again") from error


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
