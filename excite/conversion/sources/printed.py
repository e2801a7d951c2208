"""Lines that a program printed, ``q: [0.1, 0.2] tau: [1.0, 2.0]`` or ``t=0.1 q1=0.2``, behind a heading or not."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes.array_streams import longest_streams, stream_of_arrays
from excite.conversion.sources.source import Source, damaged
from excite.conversion.sources.stamps import seconds
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

_MAX_BYTES = 512 * 1024 * 1024
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_PAIR = re.compile(rf"([A-Za-z_][\w./]*)'?\s*[:=]\s*(?:[\[({{]([^\])}}]*)[\])}}]|({_NUMBER})(?![\w.:]))")
_FIRST = re.compile(_NUMBER)
_WORD = re.compile(r"[A-Za-z_]\w*")
# Seconds since 1970 in brackets, as ROS writes them; or a date and time of day.
_EPOCH = re.compile(r"\[(\d{9,10}\.\d+)\]")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d[.,]\d+")
# Of the first lines, the share that are such; loggers write others between.
_LOOKED_AT, _SHARE, _FEWEST = 60, 0.5, 20


class PrintedSource(Source):
    """Names with numbers or lists of numbers behind them, the same ones in line after line."""

    name: ClassVar[str] = "printed"
    summary: ClassVar[str] = (
        "lines of names and numbers as programs print them (q: [0.1, 0.2] tau: [1.0, 2.0])"
    )

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if not path.is_file() or path.suffix.lower() in {".yaml", ".yml", ".json"}:
            return False
        start = first_bytes(path, 65536)
        # JSON has double quotation marks; Python prints its dictionaries with single ones.
        opening = start.lstrip()[:2]
        if b"\0" in start or opening[:1] == b"<" or (opening[:1] == b"{" and opening != b"{'"):
            return False
        lines = start.decode("utf-8", "replace").splitlines()[:_LOOKED_AT]
        return len(lines) >= _FEWEST and sum(_holds(line) for line in lines) >= _SHARE * len(lines)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        except (OSError, MemoryError) as error:
            raise damaged(path, error, "printed lines") from error
        rows = [(line, _values(line)) for line in lines if _holds(line)]
        widths: dict[str, int] = {}
        for _, values in rows:
            for name, numbers in values.items():
                widths.setdefault(name, len(numbers))
        names = [name for name in widths if sum(name in values for _, values in rows) > _SHARE * len(rows)]
        if len(rows) < _FEWEST or not names:
            raise nothing_there(path)
        arrays = {name: np.array([_row(values, name, widths[name]) for _, values in rows]) for name in names}
        stamps = _stamps([line for line, _ in rows])
        if stamps is not None:
            arrays = {"stamp": stamps} | arrays
        return (Recording(str(path), path.stem, longest_streams(stream_of_arrays(path.stem, arrays))),)


def _holds(line: str) -> bool:
    """Whether a line has several numbers behind names; two, or a list."""
    values = _values(line)
    return sum(len(numbers) for numbers in values.values()) > 1


def _values(line: str) -> dict[str, list[float]]:
    """Numbers by their names; by the words before them, too, where a name comes again: ``J1 pos=0.1 | J2 pos=0.2``."""
    pairs: list[tuple[str, str, list[float]]] = []
    label, end = "", 0
    for match in _PAIR.finditer(line):
        words = _WORD.findall(line[end : match.start()])
        label, end = words[-1] if words else label, match.end()
        numbers = [float(number) for number in _FIRST.findall(match[3] or match[2])]
        if numbers:
            pairs.append((label, match[1], numbers))
    times = Counter(name for _, name, _ in pairs)
    found: dict[str, list[float]] = {}
    for label, name, numbers in pairs:
        found.setdefault(f"{label}/{name}" if label and times[name] > 1 else name, numbers)
    return found


def _row(values: dict[str, list[float]], name: str, width: int) -> list[float]:
    numbers = values.get(name, [])
    return numbers if len(numbers) == width else [float("nan")] * width


def _stamps(lines: list[str]) -> np.ndarray | None:
    """Times that a logger wrote before every line [s]; None where it did not."""
    for pattern in (_EPOCH, _DATE):
        found = [pattern.search(line) for line in lines]
        if all(found):
            words = [match[match.re.groups] for match in found if match]
            if pattern is _EPOCH:
                return np.array(words, dtype=float)
            return seconds([word.replace(",", ".") for word in words])
    return None
