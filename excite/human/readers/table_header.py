"""Where a laboratory's table begins, and what its columns are called: in one line, below headings, above units."""

from __future__ import annotations

import re
from collections.abc import Sequence

# A line of a table's beginning that is no row of numbers; more than any program writes.
_MOST_LINES = 60
_UNITS = frozenset("m mm cm n kn nm nmm n.m n.mm n·m n·mm n*m n*mm s ms sec hz frames frame v # -".split())
# What stands below the name of a marker or a plate: an axis, or a force's, moment's or centre's component.
_BELOW = re.compile(r"(?:force|moment|torque|cop|f|m|t|p)?[ _]?[xyz](?:\s*[\[(].*[\])])?", re.IGNORECASE)


def header_of(lines: Sequence[str], separator: str) -> tuple[list[str], int]:
    """Labels of a table's columns, and how many lines stand above its first row of numbers.

    One line of names is taken as it is. Of several, names stand below headings that hold as far as the cells beside
    them are empty (``RSHO,,`` above ``X,Y,Z``), units below names, and lines of another width say something else.

    Args:
        lines: of the file.
        separator: between cells.

    Returns:
        Labels, none where the file holds no row of numbers below names; the number of lines above the rows.
    """
    split = [_split_cells(line, separator) for line in lines[:_MOST_LINES]]
    first = next((k for k, cells in enumerate(split) if _is_row(cells)), None)
    if first is None or first == 0:
        return (split[0], 1) if split else ([], 0)
    # A separator may end the lines above and not the rows, or the other way round.
    above = [cells for cells in split[:first] if abs(len(cells) - len(split[first])) <= 1 and any(cells)]
    if not above:
        return split[0], 1
    width = max(len(cells) for cells in above)
    above = [cells + [""] * (width - len(cells)) for cells in above]
    units = above.pop() if len(above) > 1 and _are_units(above[-1]) else [""] * width
    names = above[-1]
    if len(above) > 1 and any(_BELOW.fullmatch(name) for name in names):
        names = _align_below(above[-2], names)
    labels = [f"{name} [{unit}]" if name and unit else name for name, unit in zip(names, units, strict=True)]
    return labels, first


def _split_cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.lstrip("\ufeff").split(separator)]


def _is_row(cells: Sequence[str]) -> bool:
    said = [cell for cell in cells if cell]
    return len(said) > 1 and all(_is_number(cell) for cell in said)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _are_units(cells: Sequence[str]) -> bool:
    said = [cell.strip("[]()").lower() for cell in cells if cell]
    return bool(said) and all(cell in _UNITS for cell in said)


def _align_below(headings: Sequence[str], names: Sequence[str]) -> list[str]:
    found, last = [], ""
    for heading, name in zip(headings, names, strict=True):
        last = heading or last
        found.append(f"{last}_{name}" if last and _BELOW.fullmatch(name) else name or heading)
    return found
