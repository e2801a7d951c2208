"""Text tables of any habit: separators, decimal commas, comments, lines of units, names in one line or in none."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.csv
import yaml

from excite.arrow_columns import numpy_columns
from excite.conversion.parts import NAMELESS
from excite.conversion.recording import Column, Recording, Stream, nothing_there
from excite.conversion.shapes import longest_streams, stream_of_arrays
from excite.conversion.sources.records import collect_arrays
from excite.conversion.sources.source import MAX_SOURCE_BYTES, Source, damaged, is_stamp, seconds
from excite.errors import LogError
from excite.logs.units import TICKS, UNITS, unit_named
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


# How a text table is written: its separator, its decimal sign, where names, units and numbers stand.

COMMENTS = ("#", "%", "//", ";;", "!")
# Units in lines of units that no channel of a robot has.
_OTHER_UNITS = frozenset(
    "- -- 1 % °c degc k w hz kg bar pa n/a none # counts count inc ticks bit bool enum".split()
)
_SEPARATORS = (",", ";", "\t", "|", " ")
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$|[+-]?(nan|inf(inity)?)$", re.IGNORECASE)

# Rows of a table of one column: fewer may be a text with a number in it.
_FEWEST_ALONE = 10

# How the note on names that are not believed begins.
MISFIT = "its line of names"

# Numbers or words within brackets, as data frames write arrays.
_ARRAY = re.compile(r"\s*(?:[\w.]*(?:array|tensor)\()?[\[(].*[\d'\"][^\w]*$", re.DOTALL)
# A number with a decimal comma that quotation marks keep from the separating ones.
_QUOTED_COMMA = re.compile(r'"[+-]?\d+,\d+(?:[eE][+-]?\d+)?"')
_QUOTED_ARRAY = re.compile(r'"\s*[\w.]*\(?[\[(]')


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
        folded: whether values in quotation marks go on in the next line.
        misfit: how the line of names differs from the rows where it has more or fewer cells; empty where it does not.
    """

    separator: str
    decimal: str
    skip: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool
    folded: bool = False
    misfit: str = ""


def table_habits(lines: list[str]) -> Habits | None:
    """Habits of a table by its first lines; None where no line holds numbers alone."""
    arrays = any(_QUOTED_ARRAY.search(line) for line in lines)
    folded = len(lines)
    lines = _whole_lines(lines) if arrays else lines
    folded -= len(lines)
    for separator, decimal in _candidates(lines):
        split = [split_line(line, separator) for line in lines]
        first = _first_row(split, decimal)
        if first is None:
            continue
        width = _width(split, first)
        if width < 2:
            continue
        names, units = _names_and_units(lines, split, first, width, separator)
        named = bool(names)
        misfit = "" if named or first == 0 else _misfit(split[first - 1], width)
        names = names or [f"column{k + 1}" for k in range(width)]
        return Habits(
            separator, decimal, first, tuple(_unique(names)), tuple(units), named, folded > 0, misfit
        )
    return _single_column(lines)


def _single_column(lines: list[str]) -> Habits | None:
    """Habits of a table of one column, a number a line below a name or none, as times are written beside others."""
    cells = [line.strip().rstrip(",;").strip('"') for line in lines]
    numbers = [bool(_NUMBER.match(cell)) and "," not in cell for cell in cells]
    first = next((k for k, number in enumerate(numbers) if number), len(cells))
    rows = [number for number, cell in zip(numbers[first:], cells[first:], strict=True) if cell]
    above = [cell for cell in cells[:first] if cell]
    if len(rows) < _FEWEST_ALONE or not all(rows) or len(above) > 1:
        return None
    return Habits(" ", ".", first, (above[0] if above else "column1",), (), bool(above))


def _misfit(above: list[str], width: int) -> str:
    """What is wrong with a line of names right above rows of another number of cells."""
    words = [cell for cell in above if re.match(r"[A-Za-zµ]", cell)]
    if len(words) < 2 or len(words) < len(above):
        return ""
    return f"{MISFIT} has {len(above)} cells and its rows have {width}, so that the names are not believed"


def _whole_lines(lines: list[str]) -> list[str]:
    """Lines of a table, those together that a quotation goes on in: long arrays are printed in several."""
    found: list[str] = []
    opened = False
    for line in lines:
        if opened:
            found[-1] += f" {line}"
        else:
            found.append(line)
        opened ^= line.count('"') % 2 == 1
    return found[:-1] if opened else found


def _candidates(lines: list[str]) -> list[tuple[str, str]]:
    """Separators with decimal signs, the likelier first: what stands oftenest in lines of numbers, evenly."""
    rows = [line for line in lines if line and not line.lstrip().startswith(COMMENTS)][-50:]
    if any(";" in line or "\t" in line for line in rows) and any(re.search(r"\d,\d", line) for line in rows):
        # A decimal comma stands between digits in every row; a separating one would give even numbers of columns.
        first = ";" if any(";" in line for line in rows) else "\t"
        return [(first, ","), (first, "."), (",", ".")]
    if any(_QUOTED_COMMA.search(line) for line in rows):
        return [(",", ",")]
    counts = {sep: min((len(split_line(line, sep)) for line in rows), default=0) for sep in _SEPARATORS}
    order = sorted(_SEPARATORS, key=lambda sep: (-(counts[sep] > 1), _SEPARATORS.index(sep)))
    return [(sep, ".") for sep in order] + [(" ", ",")]


def split_line(line: str, separator: str) -> list[str]:
    """Cells of a line without the blanks around them; a comment's mark at its beginning is left out."""
    if separator == " ":
        return line.split()
    if len(line) > csv.field_size_limit():
        # A whole array in a line, as programmes of controllers hold it.
        return [cell.strip().strip('"') for cell in line.split(separator)]
    return [cell.strip().strip('"') for cell in next(csv.reader([line], delimiter=separator), [])]


def of_width(cells: list[str], width: int) -> list[str]:
    """Cells without the empty one that a separator at the line's end leaves."""
    return cells[:-1] if len(cells) == width + 1 and cells[-1] == "" else cells


def _is_row(cells: list[str], decimal: str) -> bool:
    numbers = [
        cell
        for cell in cells
        if (_NUMBER.match(cell) and ("," not in cell or decimal == ","))
        or is_stamp(cell)
        or _ARRAY.match(cell)
    ]
    return len(numbers) >= 2 and len(numbers) >= 0.5 * len([cell for cell in cells if cell])


def _first_row(split: list[list[str]], decimal: str) -> int | None:
    """First line from which on all lines are rows of one width."""
    rows = [k for k, cells in enumerate(split) if _is_row(cells, decimal)]
    if not rows:
        return None
    width = len(split[rows[-1]])
    # A line of LabVIEW's header says how many samples each column has, behind a word.
    word = bool(re.match(r"[A-Za-z]", split[rows[-1]][0]))
    return next(
        (k for k in rows if len(split[k]) == width and bool(re.match(r"[A-Za-z]", split[k][0])) == word), None
    )


def _width(split: list[list[str]], first: int) -> int:
    """Columns of a table: many writers end each line by a separator, and a column may be empty to begin with."""
    width = len(split[first])
    if any(cells[-1] != "" for cells in split[first:] if len(cells) == width):
        return width
    named = any(len(cells) == width and cells[-1] != "" for cells in split[:first])
    return width if named else width - 1


def _names_and_units(
    lines: list[str], split: list[list[str]], first: int, width: int, separator: str
) -> tuple[list[str], list[str]]:
    names: list[str] = []
    units: list[str] = []
    for k in range(first - 1, -1, -1):
        text = re.sub(r"^\s*(#+|%+|//+|!+)", "", lines[k]).strip()
        cells = of_width(split_line(text, separator), width)
        # LabVIEW names a last column for remarks, which its rows leave away.
        cells = cells[:-1] if len(cells) == width + 1 and cells[-1].lower() == "comment" else cells
        if len(cells) != width and separator == " ":
            cells = split_line(text, "\t") if "\t" in text else split_line(text, ",")
        if len(cells) != width or not any(re.search(r"[A-Za-zµ]", cell) for cell in cells):
            continue
        if not names and not units and k > 0 and all(_is_unit(cell) for cell in cells):
            units = [cell.strip("[]()") for cell in cells]
            continue
        names = cells if len(set(cells)) == len(cells) else _with_headings(cells, lines[:k], separator)
        break
    return ([], []) if not names and not units else (names or units, units if names else [])


def _with_headings(names: list[str], above: list[str], separator: str) -> list[str]:
    """Names that stand more than once, behind the headings in the lines above: each holds until the next one."""
    headings = of_width(split_line(above[-1], separator), len(names)) if above else []
    if len(headings) != len(names) or not any(re.search(r"[A-Za-zµ]", cell) for cell in headings):
        return names
    if len(set(headings)) < len(headings) and len({*zip(headings, names, strict=True)}) < len(names):
        # Several levels of headings, as data frames have them.
        headings = _with_headings(headings, above[:-1], separator)
    found, last = [], ""
    for heading, name in zip(headings, names, strict=True):
        last = heading or last
        found.append(f"{last}/{name}" if last and name else last or name)
    return found


def _is_unit(cell: str) -> bool:
    bare = cell.strip().strip("[](){}<>").strip()
    return not bare or unit_named(bare) != "" or bare.lower() in _OTHER_UNITS


def _unique(names: list[str]) -> list[str]:
    found: list[str] = []
    # How many of those found have a name, or begin with it and a tilde: some files have ten thousands of columns.
    taken: Counter[str] = Counter()
    # The first of several is counted, too, so that all of them have a number.
    several = {name for name, count in Counter(names).items() if count > 2}
    for name in names:
        name = name or f"column{len(found) + 1}"
        again = 1 + taken[name]
        name = name if again == 1 and name not in several else f"{name}~{again}"
        found.append(name)
        taken.update([name, *(name[: mark.start()] for mark in re.finditer("~", name))])
    return found


# Messages as ROS prints them: ``ros2 topic echo`` or ``rostopic echo`` into a file, parted by lines of
# dashes.

# Printed messages are read at a megabyte a second; an hour of an arm at 100 Hz has 300 MB.
_ECHO_MAX_BYTES = 512 * 1024 * 1024
_ENDINGS = frozenset({".yaml", ".yml", ".txt", ".log", ".echo", ".msg", ""})
_ECHO_FIRST = re.compile(r"[A-Za-z_]\w*:")
_LINE = re.compile(r"^---\s*$", re.MULTILINE)
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class EchoSource(Source):
    """Messages of one topic, one after the other."""

    name: ClassVar[str] = "echo"
    summary: ClassVar[str] = "messages as ros2 topic echo and rostopic echo print them"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`: fields and lines of dashes."""
        if not path.is_file() or path.suffix.lower() not in _ENDINGS:
            return False
        start = first_bytes(path, 65536).decode("utf-8", "replace").lstrip()
        return bool(_LINE.search(start)) and bool(_ECHO_FIRST.match(start.removeprefix("---").lstrip()))

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_ECHO_MAX_BYTES, error=LogError)
        try:
            parts = _LINE.split(path.read_text(encoding="utf-8", errors="replace"))
            messages = [message for part in parts if isinstance(message := _parse_message(part), dict)]
        except (OSError, ValueError, yaml.YAMLError, RecursionError, MemoryError) as error:
            raise damaged(path, error, "printed messages") from error
        arrays: dict[str, Any] = {}
        said: dict[str, object] = {}
        alike, notes = _of_most_joints(messages)
        collect_arrays("", alike, arrays, said, 0)
        streams = longest_streams(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams, said, notes),)


def _parse_message(text: str) -> object:
    """A message's fields; None for one that was cut off."""
    if "&" in text:
        # No message has references, which may stand for more than there is memory.
        return None
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError:
        return None


def _of_most_joints(messages: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Messages that name the same joints, of several publishers those of most joints; a note of the others."""
    names = [str(message.get("name", message.get("joint_names", ""))) for message in messages]
    counts = Counter(names)
    best = max(counts, key=lambda name: (name.count(","), counts[name]), default="")
    alike = [message for message, name in zip(messages, names, strict=True) if name == best]
    others = len(messages) - len(alike)
    return alike, (f"{others} messages name other joints: left out",) if others else ()


# Lines that a program printed, ``q: [0.1, 0.2] tau: [1.0, 2.0]`` or ``t=0.1 q1=0.2``, behind a heading or
# not.

_MAX_BYTES = 512 * 1024 * 1024
_PRINTED_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_PAIR = re.compile(
    rf"([A-Za-z_][\w./]*)'?\s*[:=]\s*(?:[\[({{]([^\])}}]*)[\])}}]|({_PRINTED_NUMBER})(?![\w.:]))"
)
_FIRST = re.compile(_PRINTED_NUMBER)
_WORD = re.compile(r"[A-Za-z_]\w*")
# Seconds since 1970 in brackets, as ROS writes them; or a date and time of day.
_EPOCH = re.compile(r"\[(\d{9,10}\.\d+)\]")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d[.,]\d+")
# Of the first lines, the share that are such; loggers write others between.
_PRINTED_LOOKED_AT, _SHARE, _FEWEST = 60, 0.5, 20


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
        lines = start.decode("utf-8", "replace").splitlines()[:_PRINTED_LOOKED_AT]
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
