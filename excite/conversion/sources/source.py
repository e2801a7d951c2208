"""What every format of recordings has in common."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Recording
from excite.errors import LogError

# An hour at 1 kHz of an arm with 55 channels has 1.6 GB as text.
MAX_SOURCE_BYTES = 4_000_000_000
# As many numbers as a log folder's trial may hold.
MAX_NUMBERS = 200_000_000


class Source(ABC):
    """Reads recordings of one format.

    Attributes:
        name: of the format.
        summary: one line for help texts and errors.
        own_process: whether its library is known to crash or hang on damaged files, so that a child process reads.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    own_process: ClassVar[bool] = False

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a file or folder looks like this format, by its name and first bytes."""

    @abstractmethod
    def read(self, path: Path) -> tuple[Recording, ...]:
        """All recordings in it, in order.

        Raises:
            LogError: it is no such file, is damaged, or holds more than can be read.
        """


def damaged(path: Path, error: BaseException, what: str) -> LogError:
    """The error for a file that its library cannot read."""
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(
        f"cannot be read as {what} ({text[:160]})", source=path, remedy="check that the file is complete"
    )


# Dates and times of day in text, as seconds.

_DAY_S = 86_400.0
# 2026-03-01T12:00:00.123456Z, 2026/03/01 12:00:00,123; 01.03.2026 12:00:00.123; 12:00:00.123: the fraction after a
# point or a comma, a zone that is the same in every row.
_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?"
_ZONE = r"\s*(?:Z|UTC|[+-]\d{2}:?\d{2})?"
_FORMS = (
    re.compile(rf"(?P<Y>\d{{4}})[-/.](?P<M>\d{{1,2}})[-/.](?P<D>\d{{1,2}})[T\s_]+{_CLOCK}{_ZONE}"),
    re.compile(rf"(?P<D>\d{{1,2}})[.](?P<M>\d{{1,2}})[.](?P<Y>\d{{4}})[T\s,]+{_CLOCK}{_ZONE}"),
    # As America writes dates, which half of the day behind: 3/4/2024 11:59:50.004 AM.
    re.compile(
        rf"(?P<M>\d{{1,2}})/(?P<D>\d{{1,2}})/(?P<Y>\d{{4}})[,\s]+{_CLOCK}\s*(?P<half>[AaPp])\.?[Mm]\.?"
    ),
    re.compile(_CLOCK),
    # 01:23.456: minutes and seconds of a stop watch, which always has a fraction.
    re.compile(r"(?P<m>\d{1,3}):(?P<s>\d{2})[.,](?P<f>\d{1,9})"),
)


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day."""
    return any(form.fullmatch(cell.strip()) for form in _FORMS)


def seconds(cells: Sequence[str]) -> Array | None:
    """Seconds of stamps of one form, ``(n,)``, not a number where a cell is none; None where most are none.

    Times of day that pass midnight go on.
    """
    form = next((form for form in _FORMS if any(form.fullmatch(str(c).strip()) for c in cells[:20])), None)
    if form is None:
        return None
    found = np.array([_seconds(form.fullmatch(str(cell).strip())) for cell in cells])
    if np.isfinite(found).mean() <= 0.5:
        return None
    if "Y" not in form.groupindex and "h" in form.groupindex:
        steps = np.diff(found, prepend=found[:1])
        found = found + _DAY_S * np.cumsum(np.nan_to_num(steps) < -0.5 * _DAY_S)
    return found


def _seconds(match: re.Match[str] | None) -> float:
    if match is None:
        return float("nan")
    part = match.groupdict()
    day = 0.0
    if part.get("Y"):
        try:
            date = np.datetime64(f"{part['Y']}-{int(part['M']):02d}-{int(part['D']):02d}")
        except ValueError:
            return float("nan")
        day = _DAY_S * float(date.astype("datetime64[D]").astype(np.int64))
    fraction = part.get("f")
    hours = int(part.get("h") or 0)
    if part.get("half"):
        hours = hours % 12 + (12 if part["half"].lower() == "p" else 0)
    clock = 3600.0 * hours + 60.0 * int(part["m"]) + int(part["s"])
    return day + clock + (float(f"0.{fraction}") if fraction else 0.0)
