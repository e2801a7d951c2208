"""What drifts over the episodes of a data set: zeros, gains, delays and friction of each joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.report.theme import draw_figure, save_png, shorten_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = {"zero": "zero", "gain": "gain", "lag_s": "delay [s]", "friction": "dry friction"}


def plot_drift(episodes: Sequence[Mapping[str, Any]]) -> Figure:
    """One panel a measure, a line a joint, over the episodes in their order (``episodes`` of ``excite.doctor/1``)."""
    ordered = sorted(episodes, key=lambda one: str(one["episode"]))
    joints = list(dict.fromkeys(joint for one in ordered for joint in one["measures"].get("zero", {})))

    def series(name: str, joint: str) -> list[float]:
        found = [one["measures"].get(name, {}).get(joint) for one in ordered]
        return [np.nan if value is None else value for value in found]

    def paint(figure: Figure) -> None:
        for axes, (name, label) in zip(
            figure.subplots(2, 2, sharex=True).ravel(), _PANELS.items(), strict=True
        ):
            for joint in joints:
                axes.plot(series(name, joint), ".-", lw=0.7, ms=3.0, label=shorten_name(joint))
            axes.set_title(label)
        for axes in figure.axes[2:]:
            axes.set_xlabel("episode")
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=6)

    return draw_figure(paint, height_in=5.0)


def save_drift(episodes: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write the figure as PNG; returns ``path``."""
    return save_png(plot_drift(episodes), path)
