"""The steps of the signal processing, one a panel: before pale, after strong."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from excite.atomic import atomic_path
from excite.logs.signals.trace import SignalTrace
from excite.report.theme import IDENTIFIED, NOMINAL, draw_figure, shorten_name, to_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_signals(trace: SignalTrace) -> Figure:
    """Two panels a row, in the order of the steps; what each did is in its caption on the page."""
    rows = math.ceil(len(trace.steps) / 2)

    def paint(figure: Figure) -> None:
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes in panels[len(trace.steps) :]:
            axes.set_visible(False)
        for number, (axes, step) in enumerate(zip(panels, trace.steps, strict=False), start=1):
            axes.plot(step.before_x, step.before, color=NOMINAL.light, lw=0.9, label="before")
            style: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 2.8} if step.dots else {"lw": 1.3}
            axes.plot(step.after_x, step.after, color=IDENTIFIED.light, label="after", **style)
            axes.set_title(f"{number} {shorten_name(step.name)}")
            axes.set(xlabel=shorten_name(step.axis), ylabel=shorten_name(step.quantity))
            axes.margins(x=0.01)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)

    return draw_figure(paint, height_in=0.5 + 2.05 * rows)


def save_signal_figure(trace: SignalTrace, path: Path) -> Path:
    """Write the figure as a PNG; appears only when complete.

    Args:
        trace: what :func:`excite.recordings.explain_signals` found.
        path: the PNG to write.

    Returns:
        The file.
    """
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(to_png(plot_signals(trace)))
    return Path(path)
