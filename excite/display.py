"""How results show themselves: on a screen, in a notebook, and as tables that pandas takes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, ClassVar

from excite.errors import InputError

# What a terminal of the usual size shows at once, less its prompt.
_LINES, _COLUMNS = 20, 110
# Rows of a table in a notebook; to_frame() has all of them.
_ROWS = 40

Row = Mapping[str, Any]


def count(n: int, what: str) -> str:
    """So many of something.

    >>> count(1, "motion"), count(0, "motion")
    ('1 motion', '0 motions')
    """
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def percent(value: float) -> str:
    """A percentage as a person writes it: two digits, and all of what is above a hundred.

    >>> percent(0.4712), percent(99.7), percent(2400.0)
    ('0.47 %', '100 %', '2400 %')
    """
    # 99.5 and more are not two digits any longer once they are rounded.
    return f"{value:.2g} %" if abs(value) < 99.5 else f"{value:.0f} %"


def span(low: str, high: str, between: str = " … ") -> str:
    """From one number to another as both are written, or the one that they both come to.

    >>> span("3", "5"), span("5", "5"), span("0 %", "5 %", " to ")
    ('3 … 5', '5', '0 % to 5 %')
    """
    return low if low == high else f"{low}{between}{high}"


class Shown(ABC):
    """A result with a summary, which is what is seen of it.

    Dataclasses derive from it with ``repr=False``.
    """

    @abstractmethod
    def summary(self) -> str:
        """The result in a few lines."""

    def __repr__(self) -> str:
        """Its type and as much of the summary as a screen holds."""
        lines = [line for line in self.summary().splitlines() if line.strip()]
        shown = [line if len(line) <= _COLUMNS else line[: _COLUMNS - 1] + "…" for line in lines[:_LINES]]
        if len(lines) > _LINES:
            shown.append(f"… and {len(lines) - _LINES} lines more in .summary()")
        return "\n".join([f"<{type(self).__name__}>", *shown])

    def _repr_html_(self) -> str:
        """The same in a notebook."""
        first, *rest = repr(self).splitlines()[1:] or [""]
        return (
            f"<div><strong>{escape(type(self).__name__)}</strong><p>{escape(first)}</p>"
            + (f"<pre>{escape(chr(10).join(rest))}</pre>" if rest else "")
            + "</div>"
        )


class Tabled(Shown):
    """A result that is a table, or several of them by name.

    Attributes:
        tables: names that :meth:`rows` knows, the first where none is asked for.
    """

    tables: ClassVar[Sequence[str]]

    @abstractmethod
    def rows(self, table: str) -> Sequence[Row]:
        """The rows of a table, the same names in each."""

    def to_frame(self, table: str | None = None) -> Any:
        """A table of the result for pandas.

        Args:
            table: which one, where there are several; the first if left out.

        Returns:
            A ``pandas.DataFrame``.

        Raises:
            InputError: no such table, or pandas is not installed.
        """
        name = table or self.tables[0]
        if name not in self.tables:
            raise InputError(f"has no table {name!r}", remedy=f"ask for {' or '.join(self.tables)}")
        try:
            import pandas
        except ImportError as error:
            raise InputError(
                "tables need pandas, which is not installed",
                remedy="pip install pandas, or take .to_json(), which has the same numbers",
            ) from error
        return pandas.DataFrame([dict(row) for row in self.rows(name)])

    def _repr_html_(self) -> str:
        """The first line of the summary, and the first table."""
        first = next((line for line in self.summary().splitlines() if line.strip()), "")
        return (
            f"<div><strong>{escape(type(self).__name__)}</strong><p>{escape(first)}</p>"
            + _html_table(self.rows(self.tables[0]))
            + f"<p>also: <code>.summary()</code>, {_frames(self.tables)}</p></div>"
        )


def _frames(tables: Sequence[str]) -> str:
    return ", ".join(f"<code>.to_frame({escape(repr(name))})</code>" for name in tables)


def _html_table(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_cell(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows[:_ROWS]
    )
    more = f"<p>and {len(rows) - _ROWS} rows more</p>" if len(rows) > _ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    return ", ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
