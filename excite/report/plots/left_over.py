"""What a model says of a trial beside what was measured, and the difference, before and after effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from excite.report.comparisons import ForceComparison
from excite.report.plots.forces import channel_label
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_POINTS = 800


def plot_left_over(data: ForceComparison, channels: Sequence[str], closed: bool) -> Figure:
    """Two panels a channel: measured and modelled on the left, their difference on the right.

    Args:
        data: the trial; ``nominal`` is the model, ``identified`` the model with the effects.
        channels: which channels, in their order.
        closed: whether there are effects.
    """
    shown = slice(None, None, max(1, math.ceil(len(data.time) / _MAX_POINTS)))
    time = data.time[shown]
    models: list[tuple] = [(data.nominal, NOMINAL, (0, (4, 2)), "the model")]
    if closed:
        models.append((data.identified, IDENTIFIED, "-", "with the effects"))

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(channels), 2, sharex=True, squeeze=False)
        for (left, right), name in zip(grid, channels, strict=True):
            i = data.channels.index(name)
            measured, unit = data.measured[shown, i], shorten_name(data.units[i])
            left.plot(time, measured, color=INK.light, lw=1.0, label="measured")
            for values, role, line, label in models:
                left.plot(time, values[shown, i], color=role.light, lw=1.0, ls=line, label=label)
                right.plot(time, measured - values[shown, i], color=role.light, lw=0.9)
            right.axhline(0.0, color=INK.light, lw=0.6)
            left.set_title(shorten_name(channel_label(name)))
            right.set_title("measured less modelled")
            left.set_ylabel(f"[{unit}]")
            left.margins(x=0.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=0.7 + 1.45 * len(channels))
