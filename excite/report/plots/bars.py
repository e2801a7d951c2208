"""Bars along one axis, a row a name: pale ones, and strong ones in front of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.report.theme import IDENTIFIED, INK, LINE_IN, MUTED, PALE, TRUE, draw_figure, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def draw_bars(bars: Bars) -> Figure:
    """The bars, their axis and the legend."""
    rows, start = np.arange(len(bars.names)), 1.0 if bars.log else 0.0
    ends = np.array([one for one in (bars.pale, bars.strong, bars.ticks) if one is not None], dtype=float)
    # Room for texts behind the longest bar; infinity reaches the edge.
    finite = np.where(np.isfinite(ends), ends, start)
    edge = float(10.0 ** np.ceil(np.log10(1.5 * max(finite.max(), 1.0)))) if bars.log else float(finite.max())
    ends = np.minimum(ends, edge)

    def paint_bars(figure: Figure) -> None:
        axes = figure.subplots()
        if bars.log:
            axes.set(xscale="log", xlim=(start, edge))
        drawn = ends[: 1 + (bars.strong is not None)]
        for label, values, role, height in zip(
            bars.labels, drawn, (PALE, IDENTIFIED), (0.74, 0.36), strict=False
        ):
            axes.barh(rows, values - start, height, start, color=role.light, label=label)
        if bars.half_width is not None and bars.strong is not None:
            look: dict[str, Any] = {"ecolor": INK.light, "elinewidth": 1.1, "label": bars.labels[2]}
            axes.errorbar(bars.strong, rows, xerr=bars.half_width, fmt="none", **look)
        if bars.ticks is not None:
            axes.plot(bars.ticks, rows, "|", ms=12.0, mew=2.2, color=TRUE.light, label=bars.labels[-1])
        axes.axvline(start, color=INK.light, lw=1.0)
        axes.set_yticks(rows, [shorten_name(name) for name in bars.names])
        for tick, name in zip(axes.get_yticklabels(), bars.names, strict=True):
            tick.set(color=(INK if name in bars.bold else MUTED).light)
            tick.set_fontweight("bold" if name in bars.bold else "normal")
        for text, row, x in zip(bars.texts, rows, np.nan_to_num(ends, nan=start).max(axis=0), strict=False):
            axes.annotate(text, (x, row), (4.0, 0.0), textcoords="offset points", va="center", fontsize=7.0)
        axes.set(ylim=(len(rows) - 0.4, -0.6), xlabel=bars.axis)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0.0)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, [shorten_name(label) for label in labels], loc="outside upper left", ncols=4)

    return draw_figure(paint_bars, height_in=0.9 + LINE_IN * len(rows))
