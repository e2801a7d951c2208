"""Lines in panels, two a row: curves over time under one cursor on a page, drawn where no script runs and in print."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.report.comparisons import ForceComparison
from excite.report.html import data_island, inline_figure, interactive_block
from excite.report.replay.tracks import pack_table
from excite.report.theme import IDENTIFIED, INK, NOMINAL, Role, draw_figure, save_png, shorten_name, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TITLES = {
    f"{letter}{axis}": f"{what} {axis}"
    for letter, what in (("f", "force"), ("t", "moment"))
    for axis in "xyz"
}
_MOST_POINTS = 3000
# As many joints as the largest robot known here has; the layout of 250 panels takes a minute.
MOST_PANELS = 60
# What the three curves of a comparison are, and their colours.
_MODELS = (("measured", INK), ("nominal model", NOMINAL), ("identified model", IDENTIFIED))


@dataclass(frozen=True, eq=False)
class Line:
    """A curve.

    Attributes:
        label: what it is.
        values: ``(n,)``.
        role: its colour.
        dashed: whether it is.
    """

    label: str
    values: Array
    role: Role
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves in one frame.

    Attributes:
        name: of what is shown.
        unit: of the values; what stands along the axis.
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


def channel_panels(data: ForceComparison) -> list[Panel]:
    """A panel a channel, at most ``MOST_PANELS``; of a wrench forces on the left and moments on the right.

    Args:
        data: what is compared; a panel's note says how the RMSE fell.
    """
    order: Sequence[str] = data.channels
    if order == tuple(_TITLES):
        order = [name for pair in zip(order[:3], order[3:], strict=True) for name in pair]
    panels = []
    for name in order[:MOST_PANELS]:
        i = data.channels.index(name)
        measured, *models = (values[:, i] for values in (data.measured, data.nominal, data.identified))
        before, after = (float(np.sqrt(np.mean((measured - model) ** 2))) for model in models)
        lines = tuple(
            Line(label, values, role, dashed=role is NOMINAL)
            for (label, role), values in zip(_MODELS, (measured, *models), strict=True)
        )
        note = f"RMSE {before:.3g} → {after:.3g} {shorten_name(data.units[i])}"
        panels.append(Panel(channel_label(name), data.units[i], lines, note))
    return panels


def draw_panels(time: Array, panels: Sequence[Panel]) -> Figure:
    """Two panels a row, of which there is one at least, over one time ``(n,)`` [s]."""
    rows = math.ceil(len(panels) / 2)

    def paint_panels(figure: Figure) -> None:
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes, panel in zip(grid, panels, strict=False):
            for line in panel.lines:
                shown, ls = _thin_curve(line.values), (0, (4, 2)) if line.dashed else "-"
                look: dict[str, Any] = {"lw": 1.0, "ls": ls, "label": line.label, "color": line.role.light}
                axes.plot(time[shown], line.values[shown], **look)
            axes.set_title(", ".join(filter(None, (shorten_name(panel.name), panel.note))))
            axes.set(ylabel=f"[{shorten_name(panel.unit)}]")
            axes.margins(x=0.0)
        for axes in grid[: len(panels)][-2:]:
            axes.set_xlabel("time [s]")
            axes.tick_params(labelbottom=True)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, map(shorten_name, labels), loc="outside upper left", ncols=6)

    return draw_figure(paint_panels, height_in=0.7 + 1.55 * rows)


def show_panels(identifier: str, time: Array, panels: Sequence[Panel], description: str) -> str:
    """Panels over one time, under one cursor; the drawing where no script runs, and in print.

    Args:
        identifier: unique on the page.
        time: ``(n,)`` [s].
        panels: at least one.
        description: what is to be seen, for readers who cannot see it.
    """
    shown, name = _thin_curve(time), f"{identifier}-plots"
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
    return interactive_block(moving, still, data_island(f"{name}-data", spec))


def _thin_curve(values: Array) -> slice:
    return slice(None, None, max(1, math.ceil(len(values) / _MOST_POINTS)))


# What drifts over the episodes of a data set: zeros, gains, delays and friction of each joint.

_DRIFTS = {"zero": "zero", "gain": "gain", "lag_s": "delay [s]", "friction": "dry friction"}


def save_drift(episodes: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write as PNG a panel a measure, a line a joint, over the episodes (``episodes`` of ``excite.doctor/1``)."""
    ordered = sorted(
        (one["measures"] | {"": one["episode"]} for one in episodes), key=lambda one: str(one[""])
    )
    joints = dict.fromkeys(joint for one in ordered for joint in one.get("zero", {}))

    def paint_drift(figure: Figure) -> None:
        grid = figure.subplots(2, 2).ravel()
        for axes, (name, label) in zip(grid, _DRIFTS.items(), strict=True):
            for joint in joints:
                values = np.array([one.get(name, {}).get(joint) for one in ordered], dtype=float)
                axes.plot(values, marker=".", ms=3.0, lw=0.7, label=joint)
            axes.set(title=label, xlabel="episode")
            axes.margins(x=0.01)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, map(shorten_name, labels), loc="outside upper left", ncols=6)

    return save_png(draw_figure(paint_drift, height_in=5.1), path)
