"""Lines in panels, two a row, under one cursor on a page and drawn where no script runs; bars, a row a name."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.report.comparisons import ForceComparison
from excite.report.html import data_island, inline_figure, interactive_block
from excite.report.replay.tracks import pack_table
from excite.report.theme import (
    IDENTIFIED,
    INK,
    LINE_IN,
    MUTED,
    NOMINAL,
    PALE,
    TRUE,
    Role,
    draw_figure,
    save_png,
    shorten_name,
    to_svg,
)

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
