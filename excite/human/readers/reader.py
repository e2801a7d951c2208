"""What every reader of recordings offers, and text files' common parts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.formats.file import read_text
from excite.human.recording import Recording

# Ten minutes of sixty markers at 200 Hz have 250 MB; as numbers of Python's they take five times as much.
MAX_TEXT_BYTES = 256 * 1024 * 1024
_MOST_LABELS = 100_000
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


def read_lines(path: Path) -> list[str]:
    """Lines of a text file; raises LogError."""
    return read_text(path, limit=MAX_TEXT_BYTES, error=LogError).splitlines()


def check_labels(labels: Sequence[str], path: Path) -> None:
    """Refuse names that stand twice, and more columns than any file has; raises LogError."""
    if len(labels) > _MOST_LABELS:
        raise LogError(f"has {len(labels)} columns", source=path, remedy="export it again")
    twice = [label for label, count in Counter(labels).items() if count > 1]
    if twice:
        raise LogError("stands twice", source=path, field=twice[0][:60], remedy="rename one of them")


def row_numbers(fields: list[str], path: Path, line: int) -> list[float]:
    """Numbers of a row, NaN for an empty field; raises LogError with the line."""
    try:
        return [float(text) if text.strip() else np.nan for text in fields]
    except ValueError as error:
        raise LogError(
            f"line {line} is not numeric ({' '.join(str(error).split())[:80]})",
            source=path,
            remedy="write numbers only",
        ) from error


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
