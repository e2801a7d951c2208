"""Small pieces of HTML: tables, key figures, figures with captions. Everything that comes in is escaped."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from excite.results import plain


@dataclass(frozen=True)
class Said:
    """A number in a table that is written in words of its own, and sorted as the number that it is.

    Attributes:
        value: None where it is not known.
        text: what is read.
        shade: how full the colour behind it is, from 0 to 1; None without one.
    """

    value: float | None
    text: str
    shade: float | None = None


Cell = str | float | int | bool | Said | None
Columns = Mapping[str, str | Callable[[Any], Cell]]
"""By their headers, what is in the columns of a table: a key of its rows, or what is made of a row."""
Shown = Sequence[str] | str
"""What is in a section: the sentence that says what to see, and what is below it; or HTML of its own; or nothing."""


def format_number(value: float | None, digits: int = 3) -> str:
    """A number for reading: ``digits`` significant ones, a dash for None, ∞ for infinity.

    >>> format_number(1234.567), format_number(0.000123), format_number(None), format_number(float("inf"))
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


def percent_text(share: float | None, digits: str = ".0f") -> str:
    """A share in per cent for reading; a dash for None.

    >>> percent_text(0.416), percent_text(-0.001), percent_text(0.0312, ".3g")
    ('42 %', '0 %', '3.12 %')
    """
    text = "–" if share is None else f"{100.0 * share:{digits}} %".replace("-", "−")
    return "0 %" if text == "−0 %" else text


def percent_cell(share: float | None, *, shaded: bool = False) -> Said:
    """A share in per cent in a table, the fuller its colour, the larger it is, where it is shaded."""
    shade = min(max(share or 0.0, 0.0), 1.0) if shaded else None
    return Said(share, percent_text(share), shade)


def condition_value(value: float | None) -> float:
    """A condition number from JSON, which writes an infinite one, of what nothing excites, as null."""
    return math.inf if value is None else value


def html_table(headers: Sequence[str], rows: Iterable[Sequence[Cell]], total: Sequence[Cell] = ()) -> str:
    """A table; numbers stand on the right, ``True`` and ``False`` read yes and no.

    Args:
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


def columns_table(items: Iterable[Any], columns: Columns, total: Sequence[Cell] = ()) -> str:
    """A table with a row an item; see :func:`html_table`."""
    rows = [
        [item[column] if isinstance(column, str) else column(item) for column in columns.values()]
        for item in items
    ]
    return html_table(list(columns), rows, total)


def named_rows(items: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a mapping, each with its key as ``name``."""
    return [{**item, "name": name} for name, item in items.items()]


def _is_number(value: Cell) -> bool:
    return not isinstance(value, (str, bool))


def _html_cell(value: Cell) -> str:
    if isinstance(value, bool):
        return f'<td class="{"good" if value else "bad"}">{"yes" if value else "no"}</td>'
    if isinstance(value, str):
        return f"<td>{escape(value)}</td>"
    if isinstance(value, int):
        return f'<td class="number" data-v="{value}">{str(value).replace("-", "−")}</td>'
    one = value if isinstance(value, Said) else Said(value, format_number(value))
    exact = "" if one.value is None or not math.isfinite(one.value) else f' data-v="{one.value:.9g}"'
    look = 'class="number"'
    if one.shade is not None:
        colour = f"color-mix(in srgb, var(--identified) {round(60.0 * one.shade)}%, transparent)"
        look = f'class="map" style="background: {colour}"'
    return f"<td {look}{exact}>{escape(one.text)}</td>"


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


def html_section(identifier: str, title: str, shown: Shown) -> str:
    """A titled section that starts with the sentence that says what to see in it, or what has HTML of its own."""
    if isinstance(shown, str):
        return shown
    lead, *content = shown
    head = f"<h2>{escape(title)}</h2>{html_paragraph(lead, 'lead')}"
    return f'<section id="{identifier}">{head}{"".join(content)}</section>'


def inline_figure(svg: str) -> str:
    """An inline drawing, which scrolls sideways on a narrow screen."""
    return f'<div class="wide"><figure>{svg}</figure></div>'


# What moves on a page: its scripts, which nothing but the page itself can run, and the data that they show.
#
# A page works without them: what moves stands beside what does not, which is shown where no script runs and
# in print.

# Scripts by what of a page needs them, in the order in which they are run.
_PLOTS, _REPLAY = "data-chart=", "data-replay="
_SCRIPTS = {
    "uplot.min.js": (_PLOTS, _REPLAY),
    "three.min.js": (_REPLAY,),
    "page.js": ("<",),
    "replay.js": (_REPLAY,),
}


def data_island(identifier: str, content: Any, title: str = "") -> str:
    """Data of the page for its scripts: JSON in which no text can end the element."""
    text = json.dumps(plain(content), ensure_ascii=False, separators=(",", ":"))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    named = f' data-title="{escape(title)}"' if title else ""
    return f'<script type="application/json" id="{identifier}"{named}>{text}</script>'


def interactive_block(moving: str, still: str, *islands: str) -> str:
    """What moves with its data, and ``still`` where no script runs or nothing can be drawn, and in print."""
    return f'<div class="interactive">{moving}<div class="still">{still}</div>{"".join(islands)}</div>'


def live_replay(identifier: str, robot: Any, tracks: Mapping[str, Any], still: str) -> str:
    """A robot in motion; ``still`` where no script runs or nothing can be drawn, and in print.

    Args:
        identifier: unique on the page.
        robot: of :func:`~excite.report.replay.scene.robot_scene`.
        tracks: by title, of :class:`~excite.report.replay.tracks.Tracks`.
        still: HTML.
    """
    scene, names = f"{identifier}-robot", [f"{identifier}-{i}" for i in range(len(tracks))]
    data = [data_island(name, *pair[::-1]) for name, pair in zip(names, tracks.items(), strict=True)]
    moving = f'<div class="moving replay" data-replay="{scene}" data-tracks="{" ".join(names)}"></div>'
    return interactive_block(moving, still, data_island(scene, robot), *data)


def body_scripts(body: str) -> str:
    """The scripts that a page's body needs."""
    return "".join(f"<script>{read_asset(name)}</script>" for name in _needed_scripts(body))


def content_policy(body: str) -> str:
    """What the page's reader is told to allow it: its own scripts by their hashes, its own style, and no request."""
    hashes = " ".join(f"'sha256-{_asset_hash(name)}'" for name in _needed_scripts(body))
    rules = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    return f'<meta http-equiv="Content-Security-Policy" content="{rules}">'


def _needed_scripts(body: str) -> list[str]:
    return [name for name, signs in _SCRIPTS.items() if any(sign in body for sign in signs)]


@cache
def read_asset(name: str) -> str:
    """The text of a script or a style sheet of pages."""
    return (files("excite.report") / "assets" / name).read_text(encoding="utf-8").strip()


@cache
def _asset_hash(name: str) -> str:
    return base64.b64encode(hashlib.sha256(read_asset(name).encode()).digest()).decode("ascii")
