"""Gaps of channels over their noise floors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.report.plots.forces import channel_label
from excite.report.theme import IDENTIFIED, INK, PALE, WIDTH_IN, draw_figure, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DRAWN = ("before", "after", "noise_floor")
# Least noise floor, and largest multiple of it, that an axis can show.
_LEAST, _MOST = 1e-200, 1e200
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def plot_gap(channels: Mapping[str, Mapping[str, Any]], closed: bool) -> Figure:
    """A bar a channel from the noise floor to the gap, on a logarithmic scale; a narrow one with the effects.

    Args:
        channels: by name, ``before``, ``after`` and ``noise_floor``, in one unit.
        closed: whether there are effects, so that ``after`` says something.
    """
    names = list(channels)
    # A value that is not known is NaN, and its bar is not drawn.
    values = {key: np.array([c[key] for c in channels.values()], dtype=float) for key in _DRAWN}
    floor = np.maximum(values["noise_floor"], _LEAST)
    before, after = (np.clip(values[key] / floor, 1.0, _MOST) for key in ("before", "after"))
    rows = np.arange(len(names))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.barh(rows, before - 1.0, 0.72, left=1.0, color=PALE.light, label="the model")
        if closed:
            axes.barh(rows, after - 1.0, 0.34, left=1.0, color=IDENTIFIED.light, label="with the effects")
        axes.axvline(1.0, color=INK.light, lw=1.2)
        most = float(np.nanmax([*before, *after, 2.0]))
        axes.set_xscale("log")
        axes.set_xlim(0.97, 1.6 * most)
        ticks = [tick for tick in _TICKS if tick <= 1.6 * most]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.set_yticks(rows, [shorten_name(channel_label(name)) for name in names])
        axes.tick_params(axis="y", length=0)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("gap over its noise floor (no unit, log scale)")
        for row, (was, now) in enumerate(zip(before, after, strict=True)):
            if np.isnan(was) or (closed and np.isnan(now)):
                continue
            text = f"{was:.3g} → {now:.3g}" if closed else f"{was:.3g}"
            axes.annotate(
                text,
                (max(was, now if closed else was), row),
                (5, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)

    return draw_figure(paint, height_in=1.0 + 0.24 * len(names), width_in=WIDTH_IN)
