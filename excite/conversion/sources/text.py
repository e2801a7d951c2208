"""Text tables of any habit: separators, decimal commas, comments, lines of units, names in one line or in none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import NAMELESS, Column, Recording, Stream
from excite.conversion.sources.source import Source
from excite.formats.file import first_bytes
from excite.formats.tables import COMMENTS, read_table, seconds
from excite.logs.units import TICKS, UNITS, unit_named

_SUFFIXES = frozenset(".csv .tsv .tab .txt .dat .log .asc .data .lvm .prn".split())
# A table lies on its side where it has more columns than this many times its rows: few trials have less samples.
_LYING = 20
# A name, a number, and perhaps a unit before or behind it, alone in their line.
_STATED = re.compile(
    r"([A-Za-z][A-Za-z _-]*?)\s*(?:[\[(]([\wµ]+)[\])])?\s*[:=;,\t]\s*"
    r"(\d+(?:[.,]\d*)?)\s*[\[(]?([\wµ]*)[\])]?[;,\s]*$"
)
# What is stated of the rows in a unit of frequency or of time, in hertz and seconds: Sampling: 4 ms.
_OF_ROWS = re.compile(r"sampl|scan|cycle|period|interval|step|rate|freq|takt|abtast|zyklus", re.IGNORECASE)
_HERTZ = {"hz": 1.0, "khz": 1e3}
# Units in lines of units that no channel of a robot has.
_OTHER_UNITS = frozenset(
    "- -- 1 % °c degc k w hz kg bar pa n/a none # counts count inc ticks bit bool enum".split()
)


class TextSource(Source):
    """Values in text, one row a sample."""

    name: ClassVar[str] = "text"
    what: ClassVar[str] = "a table"
    summary: ClassVar[str] = "a table in text (.csv, .tsv, .txt, .dat, .log) with any separator"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`: text by its ending or by its first bytes."""
        if not path.is_file():
            return False
        start = first_bytes(path, 4096)
        if b"\0" in start and not start.startswith((b"\xff\xfe", b"\xfe\xff")):
            return False
        return path.suffix.lower() in _SUFFIXES or not path.suffix

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        table = read_table(path, strict=False, is_unit=_is_unit)
        columns = {name: _numbers(values) for name, values in table.columns.items()}
        numbers = [
            Column(name, values, unit=table.units[name])
            for name, values in columns.items()
            if values.dtype.kind == "f"
        ]
        words = {name: values for name, values in columns.items() if values.dtype.kind == "O" and any(values)}
        dress = table.dress
        if not dress.named:
            numbers = _upright(numbers)
        if not numbers and not words:
            return ()
        stream = Stream(path.stem, tuple(numbers), words=words)
        notes = [] if dress.named else [NAMELESS]
        notes += [dress.misfit] if dress.misfit else []
        notes += ["decimal commas"] if dress.decimal == "," else []
        said = said_by_header(table.head, dress.skip)
        return (Recording(str(path), path.stem, (stream,), said, tuple(notes)),)


def _is_unit(cell: str) -> bool:
    bare = cell.strip().strip("[](){}<>").strip()
    return not bare or unit_named(bare) != "" or bare.lower() in _OTHER_UNITS


def _numbers(values: Any) -> Any:
    """A column as floats; dates as seconds; words of comments within the table are no numbers; words where most are."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]").astype(np.int64) * 1e-9
    stamps = seconds(values)
    if stamps is not None:
        return stamps
    parsed = np.array([_float(value) for value in values])
    numeric = len(parsed) > 0 and np.isfinite(parsed).mean() > 0.5
    return parsed if numeric else np.asarray(values, dtype=object)


def _float(value: object) -> float:
    text = str(value)
    # 1,234.5: commas between thousands.
    text = text.replace(",", "") if "." in text.partition(",")[2] else text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return float("nan")


def said_by_header(lines: Sequence[str], above: int) -> dict[str, float]:
    """Numbers that comments and the lines above the table state, by the words before them.

    ``# sampling rate: 100 Hz``, ``Sampling: 4 ms``. Of what is said of the rows with its unit, a step is in seconds and
    called ``dt``, a rate in hertz and called ``rate``.

    Args:
        above: how many of them stand above the first row of numbers.
    """
    found = {}
    for k, line in enumerate(lines):
        comment = line.lstrip().startswith(COMMENTS)
        if not comment and k >= above:
            continue
        match = _STATED.match(line.strip(" " + "".join(COMMENTS)))
        if match is None:
            continue
        name, number = match[1].strip(), float(match[3].replace(",", "."))
        unit = (match[2] or match[4] or "").lower()
        if _OF_ROWS.search(name) and unit in _HERTZ:
            name, number = "rate", number * _HERTZ[unit]
        elif _OF_ROWS.search(name) and (tick := TICKS.get(UNITS.get(unit, ""))):
            name, number = "dt", number * tick
        found[name] = number
    return found


def _upright(columns: list[Column]) -> list[Column]:
    """Columns of a table without names, turned where it has a row a channel and a column a sample."""
    rows = len(columns[0].values) if columns else 0
    if not 0 < _LYING * rows < len(columns):
        return columns
    table = np.array([column.values for column in columns])
    return [Column(f"column{k + 1}", table[:, k]) for k in range(rows)]
