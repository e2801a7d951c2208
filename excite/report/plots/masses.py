"""Masses of the segments: nominal, identified, true."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from excite.report.comparisons import MassComparison
from excite.report.theme import IDENTIFIED, INK, PALE, TRUE, draw_figure, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_masses(data: MassComparison) -> Figure:
    """One row a segment: pale bar nominal, strong bar identified, its interval, tick true; changed ones in bold."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        rows = np.arange(len(data.names))
        style: dict[str, Any]
        axes.barh(rows, data.nominal, height=0.74, color=PALE.light, label="nominal")
        axes.barh(rows, data.identified, height=0.36, color=IDENTIFIED.light, label="identified")
        if data.half_width is not None:
            style = {"ecolor": INK.light, "elinewidth": 1.1, "fmt": "none"}
            axes.errorbar(data.identified, rows, xerr=data.half_width, label="95 %", **style)
        if data.true is not None:
            style = {
                "marker": "|",
                "markersize": 11,
                "markeredgewidth": 2.2,
                "linestyle": "none",
            }
            axes.plot(data.true, rows, color=TRUE.light, label="true", **style)
        axes.set(ylim=(len(rows) - 0.4, -0.6), xlabel="mass [kg]")
        if data.half_width is None:
            axes.set_xlim(left=min(0.0, float(np.min(data.identified))))
        axes.set_yticks(rows, [shorten_name(name) for name in data.names])
        axes.tick_params(axis="y", length=0)
        if data.changed is not None:
            for label, changed in zip(axes.get_yticklabels(), data.changed, strict=True):
                if changed:
                    label.set(fontweight="bold", color=INK.light)
        axes.grid(axis="y", visible=False)
        handles = dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
        order = [name for name in ("nominal", "identified", "95 %", "true") if name in handles]
        figure.legend([handles[name] for name in order], order, loc="outside upper left", ncols=4)

    return draw_figure(paint, height_in=1.0 + 0.21 * len(data.names))
