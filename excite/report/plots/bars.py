"""Bars along one axis, a row a name: pale ones, and strong ones in front of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.report.html import format_number
from excite.report.plots.sketch import Outlines, Shape, Sketch, Words, rectangle_corners, text_length
from excite.report.theme import GRID, IDENTIFIED, INK, MUTED, PALE, TRUE, WIDTH_IN, Role, shorten_name

_WIDTH, _ROW, _SIZE, _SMALL = 72.0 * WIDTH_IN, 15.0, 8.5, 7.0
# Heights of the pale and the strong bars and of ticks, as shares of a row's.
_WIDE, _SLIM, _TICK = 0.74, 0.36, 0.8
# Room for the numbers behind the bars [point].
_NUMBERS = 90.0


@dataclass(frozen=True, eq=False)
class Bars:
    """What is drawn.

    Attributes:
        names: of the rows.
        pale: ``(n,)`` ends of the wide bars; nothing is drawn of NaN, and infinity reaches the edge.
        strong: ``(n,)`` of the slim ones; None without.
        labels: of the two, and of ``half_width`` and ``ticks``, for the legend.
        axis: what is along it.
        log: whether bars begin at one on a logarithmic axis, else at zero.
        texts: behind the bars, one a row; none, if empty.
        half_width: ``(n,)`` half of an interval about ``strong``.
        ticks: ``(n,)`` marked values.
        bold: names that stand out.
    """

    names: Sequence[str]
    pale: Array
    strong: Array | None
    labels: tuple[str, ...]
    axis: str
    log: bool = False
    texts: Sequence[str] = ()
    half_width: Array | None = None
    ticks: Array | None = None
    bold: Collection[str] = field(default_factory=frozenset)


def draw_bars(bars: Bars) -> Sketch:
    """The bars, their axis and the legend."""
    n, names = len(bars.names), [shorten_name(name) for name in bars.names]
    values = [one for one in (bars.pale, bars.strong, bars.ticks) if one is not None]
    ends = (
        [*values, values[1] - bars.half_width, values[1] + bars.half_width]
        if bars.half_width is not None
        else values
    )
    marks = _log_marks(ends) if bars.log else _plain_marks(ends)
    left = 8.0 + max(text_length(name, _SIZE) for name in names)
    right, top = _WIDTH - (_NUMBERS if bars.texts else 12.0), 1.6 * _ROW
    bottom, rows = top + _ROW * n, top + _ROW * (np.arange(n) + 0.5)
    scale = np.log10 if bars.log else np.asarray
    low, high = (float(scale(end)) for end in (marks[0], marks[-1]))

    def place(given: Array) -> Array:
        finite = np.nan_to_num(scale(given), nan=np.nan, posinf=high)
        return left + (right - left) * np.clip((finite - low) / (high - low), 0.0, 1.0)

    start = float(place(np.array([1.0 if bars.log else 0.0]))[0])
    lines = tuple(np.array([[x, top], [x, bottom]]) for x in place(marks))
    shapes: list[Shape] = [Outlines(lines, edge=GRID, width=0.6, closed=False)]
    shapes.append(Outlines((np.array([[start, top], [start, bottom]]),), edge=INK, width=1.0, closed=False))
    key: list[tuple[str, Role]] = []
    layers = ((bars.pale, PALE, _WIDE), (bars.strong, IDENTIFIED, _SLIM))
    for label, (given, role, share) in zip(bars.labels, layers, strict=False):
        if given is None:
            continue
        half = 0.5 * share * _ROW
        drawn = [(x, y) for x, y in zip(place(given), rows, strict=True) if np.isfinite(x)]
        shapes.append(
            Outlines(tuple(rectangle_corners(start, y - half, x, y + half) for x, y in drawn), fill=role)
        )
        key.append((label, role))
    if bars.half_width is not None and bars.strong is not None:
        both = zip(
            place(bars.strong - bars.half_width), place(bars.strong + bars.half_width), rows, strict=True
        )
        spans = tuple(np.array([[a, y], [b, y]]) for a, b, y in both)
        shapes.append(Outlines(spans, edge=INK, width=1.1, closed=False))
        key.append((bars.labels[2], INK))
    if bars.ticks is not None:
        half = 0.5 * _TICK * _ROW
        spans = tuple(
            np.array([[x, y - half], [x, y + half]]) for x, y in zip(place(bars.ticks), rows, strict=True)
        )
        shapes.append(Outlines(spans, edge=TRUE, width=2.2, closed=False))
        key.append((bars.labels[-1], TRUE))
    for name, shown, y in zip(bars.names, names, rows, strict=True):
        bold = name in bars.bold
        shapes.append(Words(shown, (left - 4.0, y), INK if bold else MUTED, _SIZE, "right", bold=bold))
    behind = np.nanmax([np.full(n, start), *(place(one) for one in values)], axis=0)
    shapes += [
        Words(text, (float(x) + 4.0, y), size=_SMALL)
        for text, x, y in zip(bars.texts, behind, rows, strict=False)
    ]
    shapes += [
        Words(_mark_text(mark), (float(x), bottom + 0.5 * _ROW), MUTED, _SIZE, "center")
        for mark, x in zip(marks, place(marks), strict=True)
    ]
    shapes.append(Words(bars.axis, (0.5 * (left + right), bottom + 1.4 * _ROW), MUTED, _SIZE, "center"))
    return Sketch(_WIDTH, bottom + 2.0 * _ROW, (*colour_key(key), *shapes))


def colour_key(labels: Sequence[tuple[str, Role]]) -> list[Shape]:
    """A line of coloured squares with what they stand for."""
    shapes: list[Shape] = []
    x, y = 4.0, 0.5 * _ROW
    for text, role in labels:
        shapes.append(Outlines((rectangle_corners(x, y - 4.0, x + 20.0, y + 4.0),), fill=role))
        shapes.append(Words(shorten_name(text), (x + 26.0, y), size=_SIZE))
        x += 44.0 + text_length(shorten_name(text), _SIZE)
    return shapes


def _finite_values(ends: Sequence[Array]) -> Array:
    values = np.concatenate(ends)
    return values[np.isfinite(values)]


def _log_marks(ends: Sequence[Array]) -> Array:
    """Decades from one to what all bars stay below, and their parts where they are few."""
    finite = _finite_values(ends)
    decades = max(1, int(np.ceil(np.log10(finite.max() * 1.5)))) if finite.size else 1
    whole = 10.0 ** np.arange(decades + 1)
    if decades > 3:
        return np.asarray(whole)
    return np.append(np.outer(whole[:-1], [1.0, 2.0, 5.0]).ravel(), whole[-1])


def _plain_marks(ends: Sequence[Array]) -> Array:
    """Round numbers, zero among them, about all that is drawn."""
    finite = _finite_values(ends)
    low, high = min(0.0, finite.min(initial=0.0)), max(finite.max(initial=0.0), 1e-9)
    rough = (high - low) / 8
    decade = 10.0 ** np.floor(np.log10(rough))
    step = decade * next(part for part in (1.0, 2.0, 5.0, 10.0) if part * decade >= rough)
    return step * np.arange(np.floor(low / step), np.ceil(high / step) + 1.0)


def _mark_text(mark: float) -> str:
    return format_number(mark, 1) if mark >= 1e5 else f"{mark:g}".replace("-", "−")
