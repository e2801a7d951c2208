"""What every reader of recordings offers, and units and clocks of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.human.recording import Recording

METRES: dict[str, float] = {"m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}


class RecordingReader(ABC):
    """A format of recordings.

    Attributes:
        name: of the format.
        suffixes: endings that it answers to, lower case, with the dot.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def read(self, path: Path) -> Recording:
        """Read a file; a format without markers gives a recording without any.

        Raises:
            LogError: the file is missing or is no such file; says where.
        """


def checked_time(time: Array, path: Path) -> Array:
    """Time stamps, finite and rising; raises LogError."""
    if len(time) < 2:
        raise LogError(f"has {len(time)} rows", source=path, field="time", remedy="record longer")
    bad = np.flatnonzero(~(np.diff(time) > 0.0))
    if not np.isfinite(time).all() or len(bad):
        row = int(bad[0]) + 1 if len(bad) else int(np.argmax(~np.isfinite(time)))
        raise LogError(f"does not rise at row {row}", source=path, field="time", remedy="export it again")
    return time


def metres_per_unit(unit: str, path: Path) -> float:
    """Factor to metres; raises LogError for a unit that is none of length."""
    if unit.strip().lower() not in METRES:
        raise LogError(f"is {unit.strip()[:30]!r}", source=path, field="units", remedy="use m, cm or mm")
    return METRES[unit.strip().lower()]
