"""Text tables of any habit: separators, decimal commas, comments, lines of units, names in one line or in none."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import numpy_columns
from excite.conversion.recording import Column, Recording, Stream, nothing_there
from excite.conversion.sources.source import MAX_SOURCE_BYTES, Source, damaged, first_bytes
from excite.errors import LogError
from excite.reading.file import check_file

_COMMENTS = ("#", "%", "//", ";;", "!")
_SEPARATORS = (",", ";", "\t", "|", " ")
# Lines that are looked at to find the table's habits; headers of data loggers have some dozen lines.
_LOOKED_AT = 200
_BLOCK = 1 << 20
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$|[+-]?(nan|inf(inity)?)$", re.IGNORECASE)
_MISSING = ["", "nan", "NaN", "NAN", "NA", "null", "None", "-nan", "inf", "-inf", "Inf"]


@dataclass(frozen=True)
class Habits:
    """How a text table is written.

    Attributes:
        separator: between values; a space stands for any white space.
        decimal: point or comma.
        skip: lines before the first row of numbers.
        names: of the columns; made up (``column1`` …) where there are none.
        units: by column, as a line of units states them; empty where there is none.
        named: whether the file names its columns.
    """

    separator: str
    decimal: str
    skip: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool


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
        return path.suffix.lower() in {".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".data", ""} or not path.suffix

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
        encoding = _encoding(first_bytes(path, 4))
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
            if values is not None
        ]
        if not numbers:
            raise nothing_there(path)
        notes = [] if habits.named else ["the file names no columns: they are called column1, column2 … here"]
        if habits.decimal == ",":
            notes.append("decimal commas")
        return (Recording(str(path), path.stem, (Stream(path.stem, tuple(numbers)),), notes=tuple(notes)),)


def table_habits(lines: list[str]) -> Habits | None:
    """Habits of a table by its first lines; None where no line holds numbers alone."""
    for separator, decimal in _candidates(lines):
        split = [split_line(line, separator) for line in lines]
        first = _first_row(split, decimal)
        if first is None:
            continue
        width = len(split[first])
        if width < 2:
            continue
        names, units = _names_and_units(lines, split, first, width, separator)
        named = bool(names)
        names = names or [f"column{k + 1}" for k in range(width)]
        return Habits(separator, decimal, first, tuple(_unique(names)), tuple(units), named)
    return None


def _candidates(lines: list[str]) -> list[tuple[str, str]]:
    """Separators with decimal signs, the likelier first: what stands oftenest in lines of numbers, evenly."""
    rows = [line for line in lines if line and not line.lstrip().startswith(_COMMENTS)][-50:]
    if any(";" in line or "\t" in line for line in rows) and any(re.search(r"\d,\d", line) for line in rows):
        # A decimal comma stands between digits in every row; a separating one would give even numbers of columns.
        first = ";" if any(";" in line for line in rows) else "\t"
        return [(first, ","), (first, "."), (",", ".")]
    counts = {sep: min((len(split_line(line, sep)) for line in rows), default=0) for sep in _SEPARATORS}
    order = sorted(_SEPARATORS, key=lambda sep: (-(counts[sep] > 1), _SEPARATORS.index(sep)))
    return [(sep, ".") for sep in order] + [(" ", ",")]


def split_line(line: str, separator: str) -> list[str]:
    """Cells of a line without the blanks around them; a comment's mark at its beginning is left out."""
    if separator == " ":
        return line.split()
    cells = [cell.strip().strip('"') for cell in next(csv.reader([line], delimiter=separator), [])]
    # Many writers end each line by a separator.
    return cells[:-1] if cells and cells[-1] == "" and len(cells) > 1 else cells


def _is_row(cells: list[str], decimal: str) -> bool:
    numbers = [cell for cell in cells if _NUMBER.match(cell) and ("," not in cell or decimal == ",")]
    return len(numbers) >= 2 and len(numbers) >= 0.5 * len([cell for cell in cells if cell])


def _first_row(split: list[list[str]], decimal: str) -> int | None:
    """First line from which on all lines are rows of one width."""
    rows = [k for k, cells in enumerate(split) if _is_row(cells, decimal)]
    if not rows:
        return None
    width = len(split[rows[-1]])
    return next((k for k in rows if len(split[k]) == width), None)


def _names_and_units(
    lines: list[str], split: list[list[str]], first: int, width: int, separator: str
) -> tuple[list[str], list[str]]:
    names: list[str] = []
    units: list[str] = []
    for k in range(first - 1, -1, -1):
        text = lines[k].lstrip().lstrip("".join({"#", "%", "/", "!"})).strip()
        cells = split_line(text, separator)
        if len(cells) != width and separator == " ":
            cells = split_line(text, "\t") if "\t" in text else split_line(text, ",")
        if len(cells) != width or not any(re.search(r"[A-Za-zµ]", cell) for cell in cells):
            continue
        if not names and not units and k > 0 and all(_is_unit(cell) for cell in cells):
            units = [cell.strip("[]()") for cell in cells]
            continue
        names = cells
        break
    return ([], []) if not names and not units else (names or units, units if names else [])


def _is_unit(cell: str) -> bool:
    return not cell or bool(
        re.fullmatch(r"[\[(]?\s*(s|sec|ms|us|µs|ns|rad|deg|°|rad/s\^?2?|deg/s\^?2?|°/s|Nm|N\.m|N·m|N\*m|mNm|A|mA|V|m|mm|-|1|m/s)\s*[\])]?", cell)
    )


def _unique(names: list[str]) -> list[str]:
    found: list[str] = []
    for name in names:
        name = name or f"column{len(found) + 1}"
        again = 1 + sum(other == name or other.startswith(f"{name}~") for other in found)
        found.append(name if again == 1 else f"{name}~{again}")
    return found


def _encoding(start: bytes) -> str:
    return "utf-16" if start.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"


def _columns(path: Path, habits: Habits, encoding: str) -> list[Any]:
    """Numbers of each column, None where a column holds none."""
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
            line = stream.readline().decode("utf-8", "replace").rstrip("\r\n")
            extra = len(next(csv.reader([line], delimiter=habits.separator), [])) - width
            stream.seek(here)
            table = pa.csv.read_csv(
                stream,
                pa.csv.ReadOptions(column_names=names + [f"_{k}" for k in range(extra)], use_threads=False),
                pa.csv.ParseOptions(
                    delimiter=habits.separator, invalid_row_handler=lambda row: "skip", ignore_empty_lines=True
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
            if number < habits.skip or line.lstrip().startswith(_COMMENTS):
                continue
            cells = split_line(line.rstrip("\r\n"), habits.separator)
            if len(cells) == width:
                rows.append(";".join(cells))
    text = "\n".join(rows).encode()
    try:
        table = pa.csv.read_csv(
            io.BytesIO(text),
            pa.csv.ReadOptions(column_names=list(habits.names), use_threads=False),
            pa.csv.ParseOptions(delimiter=";"),
            pa.csv.ConvertOptions(null_values=_MISSING, strings_can_be_null=True, decimal_point=habits.decimal),
        )
    except (ValueError, MemoryError, pa.ArrowException) as error:
        raise damaged(path, error, "a table") from error
    found = numpy_columns(table)
    return [_numbers(found[name]) for name in habits.names]


def _numbers(values: Any) -> Any:
    """A column as floats; dates as seconds; words of comments within the table are no numbers; None where none is."""
    if values.dtype.kind in "fiu":
        return values.astype(float)
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]").astype(np.int64) * 1e-9
    if values.dtype.kind == "b":
        return values.astype(float)
    parsed = np.array([_float(value) for value in values])
    return parsed if np.isfinite(parsed).mean() > 0.5 else None


def _float(value: object) -> float:
    try:
        return float(str(value).replace(",", "."))
    except ValueError:
        return float("nan")
