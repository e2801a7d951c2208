"""How a text table is written: its separator, its decimal sign, where names, units and numbers stand."""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass

from excite.conversion.columns.unit_words import unit_named
from excite.conversion.sources.stamps import is_stamp

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
