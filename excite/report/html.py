"""Small pieces of HTML: tables, key figures, figures with captions. Everything that comes in is escaped."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Said:
    """A number in a table that is written in words of its own, and sorted as the number that it is.

    Attributes:
        value: None where it is not known.
        text: what is read.
    """

    value: float | None
    text: str


Cell = str | float | int | bool | Said | None


def format_number(value: float | None, digits: int = 3) -> str:
    """A number for reading: ``digits`` significant ones, a dash for None, ∞ for infinity.

    >>> number(1234.567), number(0.000123), number(None), number(float("inf"))
    ('1235', '1.23 · 10⁻⁴', '–', '∞')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        return f"{value:.{decimals}f}".replace("-", "−")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa} · 10{raised}".replace("-", "−")


def condition_value(value: float | None) -> float:
    """A condition number from JSON, which writes an infinite one, of what nothing excites, as null."""
    return math.inf if value is None else value


def html_table(headers: Sequence[str], rows: Iterable[Sequence[Cell]], total: Sequence[Cell] = ()) -> str:
    """A table; numbers stand on the right, ``True`` and ``False`` read yes and no.

    Args:
        headers: of the columns.
        rows: which a reader may sort.
        total: a row that stays below them, whatever they are sorted by.
    """
    rows = list(rows)
    numeric = [all(_is_number(row[i]) for row in rows) for i in range(len(headers))]
    classes = [' class="number"' if flag else "" for flag in numeric]
    head = "".join(f"<th{kind}>{escape(text)}</th>" for kind, text in zip(classes, headers, strict=True))
    body = "".join("<tr>" + "".join(_html_cell(value) for value in row) + "</tr>" for row in rows)
    foot = f"<tfoot><tr>{''.join(_html_cell(value) for value in total)}</tr></tfoot>" if total else ""
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody>{foot}</table></div>'


def _is_number(value: Cell) -> bool:
    return not isinstance(value, (str, bool))


def _html_cell(value: Cell) -> str:
    if isinstance(value, bool):
        return f'<td class="{"good" if value else "bad"}">{"yes" if value else "no"}</td>'
    if isinstance(value, str):
        return f"<td>{escape(value)}</td>"
    if isinstance(value, int):
        return f'<td class="number" data-v="{value}">{str(value).replace("-", "−")}</td>'
    said, value = (value.text, value.value) if isinstance(value, Said) else (format_number(value), value)
    exact = "" if value is None or not math.isfinite(value) else f' data-v="{value:.9g}"'
    return f'<td class="number"{exact}>{escape(said)}</td>'


def folded_content(summary: str, content: str) -> str:
    """Content behind a line that opens it."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"


def key_figure(value: str, label: str, good: bool | None = None) -> str:
    """A key figure: the value large, what it is below; ``good`` adds a mark that does not rest on colour."""
    mark = "" if good is None else f' <span class="{"good" if good else "bad"}">{"✓" if good else "✗"}</span>'
    return f'<div class="tile"><b>{escape(value)}{mark}</b><span>{escape(label)}</span></div>'


def html_paragraph(text: str, kind: str = "") -> str:
    """A paragraph; ``kind`` is a CSS class. What stands between backticks is typed."""
    said = re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))
    return f'<p class="{kind}">{said}</p>' if kind else f"<p>{said}</p>"


def html_section(identifier: str, title: str, lead: str, *content: str) -> str:
    """A titled section that starts with the sentence that says what to see in it."""
    body = "".join(part for part in content if part)
    return (
        f'<section id="{identifier}"><h2>{escape(title)}</h2>{html_paragraph(lead, "lead")}{body}</section>'
    )


def inline_figure(svg: str) -> str:
    """An inline drawing, which scrolls sideways on a narrow screen."""
    return f'<div class="wide"><figure>{svg}</figure></div>'
