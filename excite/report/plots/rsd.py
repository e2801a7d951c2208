"""Relative standard deviations of the base parameters, iteration by iteration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure
from excite.shown import count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_rsd(iterations: Sequence[dict], target_percent: float | None = None) -> Figure:
    """A column of points an iteration: dots meet their target, crosses do not; the bar is the median.

    Args:
        iterations: the campaign file's ``iterations``.
        target_percent: drawn as a line where given [%].
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for x, iteration in enumerate(iterations):
            _draw_column(axes, x, iteration)
        if target_percent is not None:
            axes.axhline(target_percent, color=INK.light, lw=0.9, ls=(0, (5, 3)))
            label = f"target {target_percent:g} %"
            axes.text(
                1.0, target_percent, label, transform=axes.get_yaxis_transform(), va="bottom", ha="right"
            )
        axes.set(yscale="log", ylabel="relative standard deviation [%]", xlim=(-0.6, len(iterations) - 0.4))
        labels = [
            f"iteration {i}\n{count(step.get('n_motions', 0), 'motion')}\n"
            f"{_n_met(step)} of {len({*step['rsd_percent'], *step.get('not_met', ())})} parameters meet it"
            for i, step in enumerate(iterations, start=1)
        ]
        axes.set_xticks(range(len(iterations)), labels)
        axes.grid(axis="x", visible=False)
        handles, names = axes.get_legend_handles_labels()
        unique = dict(zip(names, handles, strict=True))
        figure.legend(list(unique.values()), list(unique), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=3.6)


def _n_met(iteration: dict) -> int:
    missed = set(iteration.get("not_met", ()))
    return sum(name not in missed for name in iteration["rsd_percent"])


def _draw_column(axes: Axes, x: int, iteration: dict) -> None:
    missed = set(iteration.get("not_met", ()))
    names = sorted(
        iteration["rsd_percent"], key=lambda name: (iteration["rsd_percent"][name] or np.inf, name)
    )
    values = np.array([iteration["rsd_percent"][name] or np.nan for name in names], dtype=float)
    met = np.array([name not in missed for name in names])
    # Points that lie close in value are spread sideways by their rank: the golden ratio never aligns them.
    spread = 0.56 * ((np.arange(len(names)) * 0.6180339887498949) % 1.0 - 0.5)
    for which, marker, color, label in (
        (met, "o", IDENTIFIED.light, "meets the target"),
        (~met, "x", NOMINAL.light, "does not"),
    ):
        axes.plot(
            x + spread[which], values[which], marker, ms=3.6, mew=1.0, color=color, label=label, alpha=0.75
        )
    if np.isfinite(values).any():
        axes.plot([x - 0.34, x + 0.34], [np.nanmedian(values)] * 2, color=INK.light, lw=2.0, label="median")
