"""Condition number of each segment before and after the choice of motions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from excite.report.data import ConditioningComparison
from excite.report.theme import IDENTIFIED, PALE, draw, short

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_conditioning(data: ConditioningComparison) -> Figure:
    """Log bars, one row a segment: pale before, strong after; what nothing excites reaches the edge."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        rows = np.arange(len(data.segments))
        finite = np.concatenate([data.before, data.after])
        finite = finite[np.isfinite(finite)]
        edge = 10.0 ** np.ceil(np.log10(finite.max() * 1.5)) if len(finite) else 10.0
        for values, color, height, label in (
            (data.before, PALE.light, 0.74, data.before_label),
            (data.after, IDENTIFIED.light, 0.36, data.after_label),
        ):
            shown = np.where(np.isfinite(values), values, edge)
            axes.barh(rows, shown - 1.0, left=1.0, height=height, color=color, label=short(label))
        longer = np.nan_to_num(np.maximum(data.before, data.after), posinf=edge)
        for row, end, *pair in zip(rows, longer, data.before, data.after, strict=True):
            text = " → ".join(f"{value:.3g}".replace("inf", "∞") for value in pair)
            axes.annotate(text, (end, row), (4, 0), textcoords="offset points", va="center", fontsize=7.0)
        axes.set(xscale="log", xlim=(1.0, edge), ylim=(len(rows) - 0.4, -0.6))
        axes.set_yticks(rows, [short(name) for name in data.segments])
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("condition number of the segment's ten columns (no unit, log scale, less is better)")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)

    return draw(paint, height_in=1.1 + 0.21 * len(data.segments))
