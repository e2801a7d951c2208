"""Forces and moments, or joint torques, of a trial that the identification has not seen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from excite.report.comparisons import ForceComparison
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_TITLES = {
    **{f"f{axis}": f"force {axis}" for axis in "xyz"},
    **{f"t{axis}": f"moment {axis}" for axis in "xyz"},
}
_MAX_POINTS = 3000
# As many joints as the largest robot known here has; the layout of 250 panels takes a minute.
MOST_PANELS = 60


def channel_label(channel: str) -> str:
    """A channel's name for reading: ``force x`` for ``fx``; a joint's own name otherwise."""
    return _TITLES.get(channel, channel.removesuffix("_joint").replace("_", " "))


def plot_forces(
    data: ForceComparison, labels: tuple[str, str, str] = ("measured", "nominal model", "identified model")
) -> Figure:
    """One panel a channel, forces left and moments right for a wrench; its title says how the RMSE fell.

    Of more than ``MOST_PANELS`` channels the first ones. ``labels`` name what is measured, nominal and identified.
    """
    n = min(len(data.channels), MOST_PANELS)
    rows = math.ceil(n / 2)
    down_columns = data.channels == _WRENCH
    shown = slice(None, None, max(1, math.ceil(len(data.time) / _MAX_POINTS)))

    def paint(figure: Figure) -> None:
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
        panels = grid.T.ravel() if down_columns else grid.ravel()
        for i, axes in enumerate(panels):
            if i >= n:
                axes.set_visible(False)
                continue
            time = data.time[shown]
            curves = (
                (data.measured, INK, "-"),
                (data.nominal, NOMINAL, (0, (4, 2))),
                (data.identified, IDENTIFIED, "-"),
            )
            for label, (values, color, line) in zip(labels, curves, strict=True):
                axes.plot(time, values[shown, i], color=color.light, lw=1.0, ls=line, label=label)
            before, after = (
                _root_mean_square(data.measured[:, i] - model[:, i])
                for model in (data.nominal, data.identified)
            )
            name, unit = shorten_name(channel_label(data.channels[i])), shorten_name(data.units[i])
            axes.set_title(f"{name}, RMSE {before:.3g} → {after:.3g} {unit}")
            axes.set_ylabel(f"[{unit}]")
            axes.margins(x=0.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        if n % 2 and rows > 1:
            grid[-2, 1].set_xlabel("time [s]")
            grid[-2, 1].tick_params(labelbottom=True)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=0.7 + 1.55 * rows)


def _root_mean_square(residual: np.ndarray) -> float:
    return float(np.sqrt(np.mean(residual**2)))
