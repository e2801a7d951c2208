"""Text tables of any dress: separators, decimal signs, encodings, comments, headings, lines of units, packing.

Every user reads CSV here. A *strict* reader refuses a table whose rows have another number of cells than its names, and
a name that stands twice; one that is not strict, for recordings of any programme, leaves such rows out.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from excite.data_tables import read_rows
from excite.errors import InputError
from excite.formats.arrow import arrow_table, numpy_columns
from excite.formats.file import (
    BLOCK,
    MAX_COLUMNS,
    MAX_FILE_BYTES,
    check_file,
    check_size,
    check_unique,
    first_bytes,
    unreadable,
)
from excite.formats.format import ColumnFormat, Content

# Lines that are looked at to find the table's dress; headers of data loggers have some dozen lines.
_LOOKED_AT = 200
_MOST_COMMENTS = 1000
# What stands where a number is missing; infinities of a recording are of channels that its logger did not have.
_MISSING = ["", "nan", "NaN", "NAN", "NA", "null", "None", "-nan"]
_INFINITIES = ["inf", "-inf", "Inf"]
COMMENTS = ("#", "%", "//", ";;", "!")
# To SI, by the words of lines of units and of brackets behind names, of which an empty one is a unit.
SI_FACTORS = {
    word: float(row["factor"])
    for row in read_rows(__file__, "si_factors.csv")
    for word in row["words"].split(" ")
}
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$|[+-]?(nan|inf(inity)?)$", re.IGNORECASE)
_BRACKETS = re.compile(r"\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*$")
_SEPARATORS = (",", ";", "\t", "|", " ")
# Rows of a table of one column: fewer may be a text with a number in it.
_FEWEST_ALONE = 10
# How the note on names that are not believed begins.
MISFIT = "its line of names"
# Numbers or words within brackets, as data frames write arrays.
_ARRAY = re.compile(r"\s*(?:[\w.]*(?:array|tensor)\()?[\[(].*[\d'\"][^\w]*$", re.DOTALL)
# A number with a decimal comma that quotation marks keep from the separating ones.
_QUOTED_COMMA = re.compile(r'"[+-]?\d+,\d+(?:[eE][+-]?\d+)?"')
_QUOTED_ARRAY = re.compile(r'"\s*[\w.]*\(?[\[(]')
# What stands below the name of a marker or a plate: an axis, or a force's, moment's or centre's component.
_COMPONENT = re.compile(r"(?:force|moment|torque|cop|f|m|t|p)?[ _]?[xyz](?:\s*[\[(].*[\])])?", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Table:
    """A text table.

    Attributes:
        columns: by name, ``(n,)`` each; words (``object``) where a column holds no numbers alone.
        units: by name, as the file states them in a line of units or in brackets; empty where it does not.
        head: the file's first lines.
        dress: how it is written.
        written_names: names of the columns with the units in brackets that were parted from them.
    """

    columns: dict[str, NDArray[Any]]
    units: dict[str, str]
    head: tuple[str, ...]
    dress: Dress
    written_names: tuple[str, ...] = ()

    @property
    def comments(self) -> Iterator[str]:
        """Texts of the comments above the table."""
        for line in self.head[: self.dress.skip]:
            if line.lstrip().startswith(COMMENTS):
                yield line.lstrip(" " + "".join(COMMENTS)).rstrip()

    def in_si(self, path: Path) -> dict[str, NDArray[Any]]:
        """The columns in SI by the units that the file states; raises InputError for a unit that is not known."""
        found = {}
        for name, values in self.columns.items():
            factor = SI_FACTORS.get(self.units[name].lower())
            if factor is None:
                raise InputError(
                    f"is in {self.units[name][:30]!r}, a unit that is not known here",
                    source=path,
                    field=name[:60],
                    remedy="write SI units, radians for angles",
                )
            found[name] = values if factor == 1.0 or values.dtype.kind not in "fiu" else factor * values
        return found


def is_unit(cell: str) -> bool:
    """Whether a cell of a line of units is one of :data:`SI_FACTORS`, in brackets or not."""
    return cell.strip().strip("[](){}<>").strip().lower() in SI_FACTORS


def read_table(
    path: Path,
    *,
    strict: bool = True,
    below: str = "",
    is_unit: Callable[[str], bool] = is_unit,
) -> Table:
    """Read a text table.

    Args:
        strict: whether the table must have names, and every row as many cells. Units in brackets behind a name are
            then parted from it.
        below: the line that the table stands below, such as ``endheader``; empty where no such line is asked for.
        is_unit: whether a cell may stand in a line of units.

    Raises:
        InputError: the file cannot be read or holds more than is read; strict, a row or the names are wrong. It says
            where.
    """
    path = check_file(path, limit=MAX_FILE_BYTES)
    with unreadable(path):
        encoding = _find_encoding(path)
        lines = _read_head(path, encoding, strict=strict)
        above = (
            next((k for k, line in enumerate(lines, 1) if line.strip().lower() == below), 0) if below else 0
        )
        if below and not above:
            raise InputError(f"has no {below} and rows below", source=path, remedy="export it again")
        own = lines[above:]
        dress = find_dress(own, is_unit, strict=strict) or (_dress_of_words(own) if strict else None)
        if dress is None:
            return Table({}, {}, tuple(lines), Dress(",", ".", 0, (), (), False))
        dress = _with_numbers_as_names(dress, own) if strict else dress
        written_names = dress.names
        dress = _check_names(dress, above, path) if strict else dress
        dress = replace(dress, skip=above + dress.skip)
        columns = _parse_columns(path, dress, encoding, strict=strict)
    units = dict(zip(dress.names, dress.units or ("",) * len(dress.names), strict=True))
    return Table(columns, units, tuple(lines), dress, written_names)


class CsvFormat(ColumnFormat):
    """Values in text under one line of names; see :func:`read_table`."""

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".tsv", ".txt")

    def _read(self, path: Path) -> Content:
        table = read_table(path)
        if not table.columns:
            raise InputError(
                "cannot be read (it is empty)", source=path, remedy="check that it is the right file"
            )
        written = dict(zip(table.written_names, table.columns.values(), strict=True))
        statement = next((text for text in table.comments if text.startswith("{")), "")
        return Content(table.in_si(path), statement, written)

    def write(self, columns: Mapping[str, NDArray[Any]], path: Path, statement: str = "") -> None:
        """See :meth:`ColumnFormat.write`."""
        with path.open("wb") as stream:
            stream.write(f"# {statement}\n".encode() if statement else b"")
            options = pa.csv.WriteOptions(quoting_style="none" if not statement else "needed")
            pa.csv.write_csv(arrow_table(columns), stream, write_options=options)


def csv_text(names: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Rows as comma-separated text under their names: numbers with all digits, nothing for None."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(
        [["" if v is None else repr(float(v)) if isinstance(v, float) else v for v in row] for row in rows]
    )
    return stream.getvalue()


def numbers_of_words(values: NDArray[Any], name: str, path: Path, skip: int) -> NDArray[Any]:
    """A column as numbers, NaN where a cell is empty; raises InputError with the line of the first word."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    for row, cell in enumerate(values):
        if cell is not None and not _NUMBER.match(str(cell).strip()):
            raise InputError(
                f"line {skip + row + 1} is not numeric ({str(cell)[:60]!r} in {name[:60]})",
                source=path,
                remedy="write numbers only",
            )
    return np.array([math.nan if cell is None else float(str(cell).replace(",", ".")) for cell in values])


def _with_numbers_as_names(dress: Dress, lines: Sequence[str]) -> Dress:
    """The dress of a table that has names, those of the first line, though they may be numbers."""
    words = _dress_of_words(lines)
    if dress.named or dress.misfit or words is None:
        return dress
    names = tuple(split_line(lines[words.skip - 1], dress.separator))
    return (
        replace(dress, names=names, skip=words.skip, named=True) if len(names) == len(dress.names) else words
    )


def _check_names(dress: Dress, above: int, path: Path) -> Dress:
    """The dress of a table with names, each once, units in brackets behind them taken off; raises InputError."""
    check_size(0, len(dress.names), path)
    if not dress.named and dress.misfit:
        raise InputError(
            f"line {above + dress.skip + 1} has {len(dress.names)} fields for {dress.n_named} columns",
            source=path,
            remedy="write one field a column, empty for what is missing",
        )
    names, units = [], list(dress.units or ("",) * len(dress.names))
    for k, name in enumerate(dress.names):
        match = _BRACKETS.search(name)
        word = (match[1] or match[2] or "").strip() if match else ""
        if match and word.lower() in SI_FACTORS and match.start():
            names.append(name[: match.start()])
            units[k] = word
        else:
            names.append(name)
    check_unique(names, path)
    return Dress(
        dress.separator, dress.decimal, dress.skip, tuple(names), tuple(units), dress.named, dress.folded
    )


def _read_head(path: Path, encoding: str, *, strict: bool) -> list[str]:
    """The first lines, comments above the table not counted."""
    # A recording that lies on its side has a line a channel.
    longest = 50 * MAX_COLUMNS if strict else MAX_FILE_BYTES
    found: list[str] = []
    comments = 0
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        while len(found) - comments < _LOOKED_AT and (line := stream.readline(longest + 1)):
            is_comment = line.startswith("#")
            comments += is_comment
            if len(line) > longest:
                text = f"has a line of more than {longest} characters where the columns' names should stand"
                raise InputError(text, source=path, remedy="check that it is the right file")
            if comments > _MOST_COMMENTS:
                text = f"begins with more than {_MOST_COMMENTS} lines of comments"
                raise InputError(text, source=path, remedy="check that it is the right file")
            found.append(line.rstrip("\r\n"))
    return found


def _find_encoding(path: Path) -> str:
    """Of the file: what says so itself, else UTF-8 where all of it is, else that of Western European Windows."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    with path.open("rb") as stream:
        if stream.read(2) in (b"\xff\xfe", b"\xfe\xff"):
            return "utf-16"
        stream.seek(0)
        try:
            while block := stream.read(BLOCK):
                decoder.decode(block)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "latin-1"
    return "utf-8-sig"


def _parse_columns(path: Path, dress: Dress, encoding: str, *, strict: bool) -> dict[str, NDArray[Any]]:
    """Columns of the rows: numbers, or words where a column does not hold numbers alone."""
    start = first_bytes(path, BLOCK)
    of_carriage_returns = b"\r" in start and b"\n" not in start
    rewritten = dress.separator == " " or encoding == "utf-16" or of_carriage_returns
    separator = ";" if dress.separator == " " else dress.separator
    width = len(dress.names)
    bad: list[pa.csv.InvalidRow] = []

    def judge_column(row: pa.csv.InvalidRow) -> str:
        if not bad and not row.text.lstrip().startswith(COMMENTS) and row.text.strip(separator + ' "'):
            bad.append(row)
        return "skip"

    with _rewrite_rows(path, dress, encoding, separator) if rewritten else path.open("rb") as stream:
        extra = 0
        if not rewritten:
            for _ in range(dress.skip):
                stream.readline()
            here = stream.tell()
            first = stream.readline().decode(encoding.removesuffix("-sig"), "replace").rstrip("\r\n")
            extra = len(split_line(first, separator)) - width
            extra = extra if extra == 1 or not strict else 0
            stream.seek(here)
            if not first and not stream.read(1):
                return {name: np.empty(0, dtype=object) for name in dress.names}
            stream.seek(here)
        table = pa.csv.read_csv(
            stream,
            pa.csv.ReadOptions(
                column_names=[*dress.names, *(f"_{k}" for k in range(extra))],
                use_threads=False,
                encoding="utf-8" if rewritten else encoding.removesuffix("-sig"),
            ),
            pa.csv.ParseOptions(
                delimiter=separator,
                invalid_row_handler=judge_column,
                newlines_in_values=dress.folded,
                ignore_empty_lines=True,
            ),
            pa.csv.ConvertOptions(
                null_values=_MISSING if strict else _MISSING + _INFINITIES,
                strings_can_be_null=True,
                decimal_point=dress.decimal,
            ),
        )
    if strict and bad:
        row = bad[0]
        raise InputError(
            f"line {dress.skip + (row.number or 0)} has {row.actual_columns} fields for {width} columns",
            source=path,
            remedy="write one field a column, empty for what is missing",
        )
    check_size(table.num_rows * width, width if strict else 0, path)
    found = numpy_columns(table)
    return {name: found[name] for name in dress.names}


def _rewrite_rows(path: Path, dress: Dress, encoding: str, separator: str) -> BinaryIO:
    """Rows in UTF-8 with one separator between cells: of tables in columns of blanks, and of UTF-16."""
    width, rows = len(dress.names), []
    with path.open(encoding=encoding, errors="replace") as stream:
        for number, line in enumerate(stream):
            if number < dress.skip or line.lstrip().startswith(COMMENTS) or not line.strip():
                continue
            cells = of_width(split_line(line.rstrip("\r\n"), dress.separator), width)
            rows.append(separator.join(f'"{cell}"' if separator in cell else cell for cell in cells))
    return io.BytesIO("\n".join(rows).encode() or b"\n")


def _dress_of_words(lines: Sequence[str]) -> Dress | None:
    """Names alone, or above rows without numbers: a table in which every column is to be refused by who needs it."""
    k = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENTS)), None
    )
    if k is None:
        return None
    separator = max(",;\t", key=lines[k].count)
    return Dress(separator, ".", k + 1, tuple(split_line(lines[k], separator)), (), True)


# How a table is written: its separator, its decimal sign, where names, units and numbers stand.


@dataclass(frozen=True)
class Dress:
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
        n_named: how many cells that line has.
    """

    separator: str
    decimal: str
    skip: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool
    folded: bool = False
    misfit: str = ""
    n_named: int = 0


def find_dress(
    lines: list[str], is_unit: Callable[[str], bool] = is_unit, *, strict: bool = False
) -> Dress | None:
    """Dress of a table by its first lines; None where no line holds numbers alone."""
    arrays = any(_QUOTED_ARRAY.search(line) for line in lines)
    folded = len(lines)
    lines = _whole_lines(lines) if arrays else lines
    folded -= len(lines)
    for separator, decimal in _list_separators(lines):
        split = [split_line(line, separator) for line in lines]
        first = _first_row(split, decimal)
        if first is None:
            continue
        width = _count_columns(split, first)
        if width < 2:
            continue
        names, units, above = _names_and_units(lines, split, first, width, separator, is_unit, strict=strict)
        misfit = 0 if names or first == 0 else _misfit_cells(split[first - 1], width)
        text = f"{MISFIT} has {misfit} cells and its rows have {width}, so that the names are not believed"
        # Strictly, all below the names is rows; else those of what was not seen hold their time alone.
        first = above if strict and names else first
        while names and first > above and _is_sparse_row(lines[first - 1], split[first - 1], width):
            first -= 1
        named, names = bool(names), names or [f"column{k + 1}" for k in range(width)]
        unique = names if strict else _unique_names(names)
        return Dress(
            separator,
            decimal,
            first,
            tuple(unique),
            tuple(units),
            named,
            folded > 0,
            text if misfit else "",
            misfit,
        )
    return _single_column(lines)


def _is_sparse_row(line: str, cells: list[str], width: int) -> bool:
    """Whether a line is a row of which most cells are empty."""
    said = [cell for cell in cells if cell]
    return (
        len(cells) == width
        and not line.lstrip().startswith(COMMENTS)
        and all(map(_NUMBER.match, said))
        and any(said)
    )


def _single_column(lines: list[str]) -> Dress | None:
    """Dress of a table of one column, a number a line below a name or none, as times are written beside others."""
    cells = [line.strip().rstrip(",;").strip('"') for line in lines]
    numbers = [bool(_NUMBER.match(cell)) and "," not in cell for cell in cells]
    first = next((k for k, number in enumerate(numbers) if number), len(cells))
    rows = [number for number, cell in zip(numbers[first:], cells[first:], strict=True) if cell]
    above = [cell for cell in cells[:first] if cell]
    if len(rows) < _FEWEST_ALONE or not all(rows) or len(above) > 1:
        return None
    return Dress(" ", ".", first, (above[0] if above else "column1",), (), bool(above))


def _misfit_cells(above: list[str], width: int) -> int:
    """Cells of a line of names right above rows of another number of cells; 0 where it is no such line."""
    words = [cell for cell in above if re.match(r"[A-Za-zµ]", cell)]
    return 0 if len(words) < 2 or len(words) < len(above) or len(above) == width else len(above)


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


def _list_separators(lines: list[str]) -> list[tuple[str, str]]:
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
        quoted = csv.reader([line.replace("\t", " ").strip()], delimiter=" ", skipinitialspace=True)
        return next(quoted, []) if '"' in line else line.split()
    if len(line) > csv.field_size_limit():
        # A whole array in a line, as programmes of controllers hold it.
        return [cell.strip().strip('"') for cell in line.split(separator)]
    # A return within a line ends none.
    cells = next(csv.reader([line.replace("\r", " ")], delimiter=separator), [])
    return [cell.strip().strip('"') for cell in cells]


def of_width(cells: list[str], width: int) -> list[str]:
    """Cells without the empty one that a separator at the line's end leaves."""
    return cells[:-1] if len(cells) == width + 1 and cells[-1] == "" else cells


def _is_row(cells: list[str], decimal: str) -> bool:
    numbers = [
        cell
        for cell in cells
        if (_NUMBER.match(cell) and ("," not in cell or decimal == ","))
        or any(form.fullmatch(cell.strip()) for form in _FORMS)
        or _ARRAY.match(cell)
    ]
    return len(numbers) >= 2 and len(numbers) >= 0.5 * len([cell for cell in cells if cell])


def _first_row(split: list[list[str]], decimal: str) -> int | None:
    """First line from which on all lines are rows of one width."""
    rows = [k for k, cells in enumerate(split) if _is_row(cells, decimal)]
    if not rows:
        return None
    # Of most rows, since the last one may be cut; of as many, of the later ones.
    counts = Counter(len(split[k]) for k in rows)
    width = max(counts, key=lambda w: (counts[w], max(k for k in rows if len(split[k]) == w)))
    # A line of LabVIEW's header says how many samples each column has, behind a word.
    last = max(k for k in rows if len(split[k]) == width)
    word = bool(re.match(r"[A-Za-z]", split[last][0]))
    return next(
        (k for k in rows if len(split[k]) == width and bool(re.match(r"[A-Za-z]", split[k][0])) == word), None
    )


def _count_columns(split: list[list[str]], first: int) -> int:
    """Columns of a table: many writers end each line by a separator, and a column may be empty to begin with."""
    width = len(split[first])
    if any(cells[-1] != "" for cells in split[first:] if len(cells) == width):
        return width
    named = any(len(cells) == width and cells[-1] != "" for cells in split[:first])
    return width if named else width - 1


class _Heading(NamedTuple):
    """Names and units of columns, and how many lines stand down to the lower of the two."""

    names: list[str]
    units: list[str]
    above: int


def _names_and_units(
    lines: list[str],
    split: list[list[str]],
    first: int,
    width: int,
    separator: str,
    is_unit: Callable[[str], bool],
    *,
    strict: bool,
) -> _Heading:
    """Names and units of the columns, and how many lines stand down to the lower of the two."""
    names: list[str] = []
    units: list[str] = []
    above = 0
    for k in range(first - 1, -1, -1):
        text = (
            re.sub(r"^\s*(#+|%+|//+|!+)", "", lines[k]).strip()
            if separator != "\t"
            else lines[k].lstrip("#%!")
        )
        cells = of_width(split_line(text, separator), width)
        # LabVIEW names a last column for remarks, which its rows leave away.
        cells = cells[:-1] if len(cells) == width + 1 and cells[-1].lower() == "comment" else cells
        if len(cells) != width and separator == " ":
            cells = split_line(text, "\t") if "\t" in text else split_line(text, ",")
        if len(cells) != width or not any(re.search(r"[A-Za-zµ°]", cell) for cell in cells):
            continue
        above = above or k + 1
        said = [is_unit(cell) for cell in cells if cell or not strict]
        if (
            not names
            and not units
            and k > 0
            and (all(said) or (strict and 3 * sum(said) >= len(said) and len(split[k - 1]) == len(split[k])))
        ):
            units = [cell.strip("[]()") for cell in cells]
            continue
        names = cells
        if len(set(cells)) < len(cells) or any(_COMPONENT.fullmatch(cell) for cell in cells):
            names = _with_headings(cells, lines[:k], separator)
        break
    return _Heading(names or units, units if names else [], above)


def _with_headings(names: list[str], above: list[str], separator: str) -> list[str]:
    """Names that stand more than once, behind the headings in the lines above: each holds until the next one."""
    headings = of_width(split_line(above[-1], separator), len(names)) if above else []
    headings += [""] * (len(names) - len(headings)) if len(headings) == len(names) - 1 else []
    if len(headings) != len(names) or not any(re.search(r"[A-Za-zµ]", cell) for cell in headings):
        return names
    several = len(set(names)) < len(names)
    if (
        several
        and len(set(headings)) < len(headings)
        and len({*zip(headings, names, strict=True)}) < len(names)
    ):
        # Several levels of headings, as data frames have them.
        headings = _with_headings(headings, above[:-1], separator)
    found, last = [], ""
    for heading, name in zip(headings, names, strict=True):
        last = heading or last
        below = last and name and (several or _COMPONENT.fullmatch(name))
        found.append(f"{last}/{name}" if below else name or last)
    return found


def _unique_names(names: list[str]) -> list[str]:
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


def seconds(cells: Sequence[str]) -> NDArray[Any] | None:
    """Seconds of stamps of one form, ``(n,)``, not a number where a cell is none; None where most are none.

    Times of day that pass midnight go on.
    """
    form = next((form for form in _FORMS if any(form.fullmatch(str(c).strip()) for c in cells[:20])), None)
    if form is None:
        return None
    found = np.array([_stamp_seconds(form.fullmatch(str(cell).strip())) for cell in cells])
    if np.isfinite(found).mean() <= 0.5:
        return None
    if "Y" not in form.groupindex and "h" in form.groupindex:
        steps = np.diff(found, prepend=found[:1])
        found = found + _DAY_S * np.cumsum(np.nan_to_num(steps) < -0.5 * _DAY_S)
    return found


def _stamp_seconds(match: re.Match[str] | None) -> float:
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
