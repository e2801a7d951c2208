"""Curves over time, a panel a channel: under one cursor on a page, drawn where no script runs and in print."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.report.comparisons import ForceComparison
from excite.report.html import data_island, inline_figure, interactive
from excite.report.replay.tracks import pack_table
from excite.report.theme import IDENTIFIED, INK, NOMINAL, Role, draw_figure, shorten_name, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TITLES = {
    **{f"f{axis}": f"force {axis}" for axis in "xyz"},
    **{f"t{axis}": f"moment {axis}" for axis in "xyz"},
}
_MOST_POINTS = 3000
# As many joints as the largest robot known here has; the layout of 250 panels takes a minute.
MOST_PANELS = 60
MODELS = ("measured", "nominal model", "identified model")
"""What the three curves of a comparison are as a rule."""


@dataclass(frozen=True, eq=False)
class Line:
    """A curve.

    Attributes:
        label: what it is.
        role: its colour.
        values: ``(n,)``.
        dashed: whether it is.
    """

    label: str
    role: Role
    values: Array
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves in one frame.

    Attributes:
        name: of what is shown.
        unit: of the values.
        lines: the curves.
        note: what a drawing says beside the name.
    """

    name: str
    unit: str
    lines: tuple[Line, ...]
    note: str = ""


def channel_label(channel: str) -> str:
    """A channel's name for reading: ``force x`` for ``fx``; a joint's own name otherwise."""
    return _TITLES.get(channel, channel.removesuffix("_joint").replace("_", " "))


def channel_panels(
    data: ForceComparison, labels: tuple[str, str, str] = MODELS, channels: Sequence[str] = ()
) -> list[Panel]:
    """A panel a channel, at most ``MOST_PANELS``; of a wrench forces on the left and moments on the right.

    Args:
        data: what is compared; a panel's note says how the RMSE fell.
        labels: of what is measured, nominal and identified.
        channels: those shown, in their order; all, if empty.
    """
    order = channels or data.channels
    if order == tuple(_TITLES):
        order = [name for pair in zip(order[:3], order[3:], strict=True) for name in pair]
    panels = []
    for name in order[:MOST_PANELS]:
        i = data.channels.index(name)
        measured, *models = (values[:, i] for values in (data.measured, data.nominal, data.identified))
        before, after = (float(np.sqrt(np.mean((measured - model) ** 2))) for model in models)
        curves = zip(
            labels, (INK, NOMINAL, IDENTIFIED), (measured, *models), (False, True, False), strict=True
        )
        note = f"RMSE {before:.3g} → {after:.3g} {shorten_name(data.units[i])}"
        panels.append(
            Panel(channel_label(name), data.units[i], tuple(Line(*curve) for curve in curves), note)
        )
    return panels


def draw_panels(time: Array, panels: Sequence[Panel]) -> Figure:
    """Two panels a row.

    Args:
        time: ``(n,)`` [s].
        panels: at least one.
    """
    rows, shown = math.ceil(len(panels) / 2), _thinned(time)

    def paint(figure: Figure) -> None:
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes in grid.ravel()[len(panels) :]:
            axes.set_visible(False)
        for axes, panel in zip(grid.ravel(), panels, strict=False):
            for line in panel.lines:
                dashes = (0, (4, 2)) if line.dashed else "-"
                axes.plot(
                    time[shown],
                    line.values[shown],
                    color=line.role.light,
                    lw=1.0,
                    ls=dashes,
                    label=line.label,
                )
            axes.set_title(", ".join(filter(None, (shorten_name(panel.name), panel.note))))
            axes.set_ylabel(f"[{shorten_name(panel.unit)}]")
            axes.margins(x=0.0)
        for axes in grid.ravel()[: len(panels)][-2:]:
            axes.set_xlabel("time [s]")
            axes.tick_params(labelbottom=True)
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=0.7 + 1.55 * rows)


def show_panels(identifier: str, time: Array, panels: Sequence[Panel], description: str) -> str:
    """Panels over one time, under one cursor; the drawing where no script runs, and in print.

    Args:
        identifier: unique on the page.
        time: ``(n,)`` [s].
        panels: at least one.
        description: what is to be seen, for readers who cannot see it.
    """
    shown, name = _thinned(time), f"{identifier}-plots"
    drawn = [
        {
            "title": f"{panel.name} [{panel.unit}]",
            "unit": panel.unit,
            "series": [
                {"label": line.label, "role": line.role.name} | ({"dash": [5, 3]} if line.dashed else {})
                for line in panel.lines
            ],
            "values": pack_table(np.column_stack([line.values[shown] for line in panel.lines])),
        }
        for panel in panels
    ]
    spec = {"group": name, "time": pack_table(time[shown]), "panels": drawn}
    still = inline_figure(to_svg(draw_panels(time, panels), identifier, description))
    moving = f'<div class="moving plots" data-chart="{name}-data"></div>'
    return interactive(moving, still, data_island(f"{name}-data", spec))


def _thinned(time: Array) -> slice:
    return slice(None, None, max(1, math.ceil(len(time) / _MOST_POINTS)))
