"""Text tables of any habit: separators, decimal commas, comments, lines of units, names in one line or in none."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import numpy_columns
from excite.conversion.columns.clock import TICKS
from excite.conversion.columns.unit_words import UNITS
from excite.conversion.parts import NAMELESS
from excite.conversion.recording import Column, Recording, Stream, nothing_there
from excite.conversion.sources.source import MAX_SOURCE_BYTES, Source, damaged
from excite.conversion.sources.stamps import seconds
from excite.conversion.sources.table_habits import COMMENTS, Habits, of_width, split_line, table_habits
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

_SUFFIXES = frozenset(".csv .tsv .tab .txt .dat .log .asc .data .lvm .prn".split())
# Lines that are looked at to find the table's habits; headers of data loggers have some dozen lines.
_LOOKED_AT = 200
# A table lies on its side where it has more columns than this many times its rows: few trials have less samples.
_LYING = 20
_BLOCK = 1 << 20
# A name, a number, and perhaps a unit before or behind it, alone in their line.
_STATED = re.compile(
    r"([A-Za-z][A-Za-z _-]*?)\s*(?:[\[(]([\wµ]+)[\])])?\s*[:=;,\t]\s*"
    r"(\d+(?:[.,]\d*)?)\s*[\[(]?([\wµ]*)[\])]?[;,\s]*$"
)
# What is stated of the rows in a unit of frequency or of time, in hertz and seconds: Sampling: 4 ms.
_OF_ROWS = re.compile(r"sampl|scan|cycle|period|interval|step|rate|freq|takt|abtast|zyklus", re.IGNORECASE)
_HERTZ = {"hz": 1.0, "khz": 1e3}
_MISSING = ["", "nan", "NaN", "NAN", "NA", "null", "None", "-nan", "inf", "-inf", "Inf"]


class TextSource(Source):
    """Values in text, one row a sample."""

    name: ClassVar[str] = "text"
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
        check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
        encoding = _encoding(path)
        with path.open(encoding=encoding, errors="replace", newline=None) as stream:
            lines = [line.rstrip("\r\n") for _, line in zip(range(_LOOKED_AT), stream, strict=False)]
        habits = table_habits(lines)
        if habits is None:
            raise nothing_there(path)
        columns = _columns(path, habits, encoding)
        units = habits.units or ("",) * len(habits.names)
        numbers = [
            Column(name, values, unit=unit)
            for name, unit, values in zip(habits.names, units, columns, strict=True)
            if values.dtype.kind == "f"
        ]
        words = {
            name: values
            for name, values in zip(habits.names, columns, strict=True)
            if values.dtype.kind == "O" and any(values)
        }
        if not habits.named:
            numbers = _upright(numbers)
        if not numbers and not words:
            raise nothing_there(path)
        table = Stream(path.stem, tuple(numbers), words=words, nameless=not habits.named)
        notes = [] if habits.named else [NAMELESS]
        if habits.misfit:
            notes.append(habits.misfit)
        if habits.decimal == ",":
            notes.append("decimal commas")
        return (Recording(str(path), path.stem, (table,), said_by_header(lines, habits.skip), tuple(notes)),)


def said_by_header(lines: Sequence[str], above: int) -> dict[str, float]:
    """Numbers that comments and the lines above the table state, by the words before them.

    ``# sampling rate: 100 Hz``, ``Sampling: 4 ms``. Of what is said of the rows with its unit, a step is in seconds and
    called ``dt``, a rate in hertz and called ``rate``.

    Args:
        lines: the file's first ones.
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


def _encoding(path: Path) -> str:
    """Of the file: what says so itself, else UTF-8 where all of it is, else that of Western European Windows."""
    if first_bytes(path, 4).startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK):
                decoder.decode(block)
            decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _columns(path: Path, habits: Habits, encoding: str) -> list[Any]:
    """Numbers of each column, words where a column holds none."""
    if habits.separator == " " or encoding == "utf-16":
        return _columns_of_blanks(path, habits, encoding)
    width = len(habits.names)
    options = pa.csv.ConvertOptions(
        null_values=_MISSING,
        strings_can_be_null=True,
        decimal_point=habits.decimal,
    )
    names = [*habits.names]
    try:
        with path.open("rb") as stream:
            for _ in range(habits.skip):
                stream.readline()
            here = stream.tell()
            line = stream.readline().decode(encoding).rstrip("\r\n")
            extra = len(next(csv.reader([line], delimiter=habits.separator), [])) - width
            stream.seek(here)
            table = pa.csv.read_csv(
                stream,
                pa.csv.ReadOptions(
                    column_names=names + [f"_{k}" for k in range(extra)],
                    use_threads=False,
                    encoding=encoding.removesuffix("-sig"),
                ),
                pa.csv.ParseOptions(
                    delimiter=habits.separator,
                    invalid_row_handler=lambda row: "skip",
                    newlines_in_values=habits.folded,
                    ignore_empty_lines=True,
                ),
                options,
            )
    except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
        raise damaged(path, error, "a table") from error
    found = numpy_columns(table)
    return [_numbers(found[name]) for name in names]


def _columns_of_blanks(path: Path, habits: Habits, encoding: str) -> list[Any]:
    width, rows = len(habits.names), []
    with path.open(encoding=encoding, errors="replace") as stream:
        for number, line in enumerate(stream):
            if number < habits.skip or line.lstrip().startswith(COMMENTS):
                continue
            cells = of_width(split_line(line.rstrip("\r\n"), habits.separator), width)
            if len(cells) == width:
                rows.append(";".join(cells))
    text = "\n".join(rows).encode()
    try:
        table = pa.csv.read_csv(
            io.BytesIO(text),
            pa.csv.ReadOptions(column_names=list(habits.names), use_threads=False),
            pa.csv.ParseOptions(delimiter=";"),
            pa.csv.ConvertOptions(
                null_values=_MISSING, strings_can_be_null=True, decimal_point=habits.decimal
            ),
        )
    except (ValueError, MemoryError, pa.ArrowException) as error:
        raise damaged(path, error, "a table") from error
    found = numpy_columns(table)
    return [_numbers(found[name]) for name in habits.names]


def _numbers(values: Any) -> Any:
    """A column as floats; dates as seconds; words of comments within the table are no numbers; words where most are."""
    if values.dtype.kind in "fiu":
        return values.astype(float)
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]").astype(np.int64) * 1e-9
    if values.dtype.kind == "b":
        return values.astype(float)
    stamps = seconds(values)
    if stamps is not None:
        return stamps
    parsed = np.array([_float(value) for value in values])
    return parsed if np.isfinite(parsed).mean() > 0.5 else np.asarray(values, dtype=object)


def _float(value: object) -> float:
    text = str(value)
    # 1,234.5: commas between thousands.
    text = text.replace(",", "") if "." in text.partition(",")[2] else text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return float("nan")
