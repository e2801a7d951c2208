"""Condition number of each segment before and after the choice of motions."""

from __future__ import annotations

import numpy as np

from excite.report.comparisons import ConditioningComparison
from excite.report.html import format_number
from excite.report.plots.sketch import Outlines, Shape, Sketch, Words, rectangle_corners, text_length
from excite.report.theme import GRID, IDENTIFIED, MUTED, PALE, WIDTH_IN, Role, shorten_name

_WIDTH = 72.0 * WIDTH_IN
_ROW = 15.0
# Heights of the bars of before and after, as shares of a row's.
_WIDE, _SLIM = 0.74, 0.36
# Room for the numbers behind the bars [point].
_NUMBERS = 90.0
_SIZE, _SMALL = 8.5, 7.0


def draw_conditioning(data: ConditioningComparison) -> Sketch:
    """Log bars, one row a segment: pale before, strong after; what nothing excites reaches the edge."""
    names = [shorten_name(name) for name in data.segments]
    values = np.array([data.before, data.after])
    finite = values[np.isfinite(values)]
    decades = max(1, int(np.ceil(np.log10(finite.max() * 1.5)))) if finite.size else 1
    left = 8.0 + max(text_length(name, _SIZE) for name in names)
    right, top = _WIDTH - _NUMBERS, 1.6 * _ROW
    bottom = top + _ROW * len(names)
    # Of what is not finite, all of the width.
    ends = left + (right - left) * np.clip(
        np.nan_to_num(np.log10(values), posinf=decades) / decades, 0.0, 1.0
    )
    shapes: list[Shape] = list(_colour_key((data.before_label, PALE), (data.after_label, IDENTIFIED)))
    marks = left + (right - left) * np.arange(decades + 1) / decades
    lines = tuple(np.array([[x, top], [x, bottom]]) for x in marks)
    shapes.append(Outlines(lines, edge=GRID, width=0.6, closed=False))
    for row, (role, high) in zip(ends, ((PALE, _WIDE), (IDENTIFIED, _SLIM)), strict=True):
        bars = [
            rectangle_corners(
                left, top + _ROW * (i + 0.5 - 0.5 * high), x, top + _ROW * (i + 0.5 + 0.5 * high)
            )
            for i, x in enumerate(row)
        ]
        shapes.append(Outlines(tuple(bars), fill=role))
    for i, (name, end) in enumerate(zip(names, ends.max(axis=0), strict=True)):
        y = top + _ROW * (i + 0.5)
        both = " → ".join(f"{value:.3g}".replace("inf", "∞") for value in values[:, i])
        shapes += [
            Words(name, (left - 4.0, y), MUTED, _SIZE, "right"),
            Words(both, (float(end) + 4.0, y), size=_SMALL),
        ]
    shapes += [
        Words(format_number(10.0**k, 1), (float(x), bottom + 0.5 * _ROW), MUTED, _SIZE, "center")
        for k, x in enumerate(marks)
    ]
    said = "condition number of the segment's ten columns (no unit, log scale, less is better)"
    shapes.append(Words(said, (0.5 * (left + right), bottom + 1.4 * _ROW), MUTED, _SIZE, "center"))
    return Sketch(_WIDTH, bottom + 2.0 * _ROW, tuple(shapes))


def _colour_key(*labels: tuple[str, Role]) -> list[Shape]:
    shapes: list[Shape] = []
    x, y = 4.0, 0.5 * _ROW
    for text, role in labels:
        shapes.append(Outlines((rectangle_corners(x, y - 4.0, x + 20.0, y + 4.0),), fill=role))
        shapes.append(Words(shorten_name(text), (x + 26.0, y), size=_SIZE))
        x += 44.0 + text_length(shorten_name(text), _SIZE)
    return shapes
