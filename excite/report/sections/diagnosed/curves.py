"""A trial as it was measured, and as the model tells it before and after the effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from excite.arrays import Array
from excite.report.comparisons import ForceComparison
from excite.report.folder import Findings
from excite.report.html import html_section, inline_figure
from excite.report.live import live_chart
from excite.report.plots.forces import channel_label
from excite.report.plots.left_over import plot_left_over
from excite.report.sections.section import Section
from excite.report.theme import to_svg

_SHOWN = 4


class Curves(Section):
    """The channels with the largest shares of the gap."""

    identifier = "curves"
    title = "A trial before and after"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found, data = findings.diagnosis, findings.data.gap
        if found is None or data is None:
            return ""
        order = [row["channel"] for row in found["where"] if row["channel"] in data.channels]
        shown = (order or list(data.channels))[:_SHOWN]
        closed = bool(found["effects"])
        lead = (
            f"Trial {data.trial}: what was measured and what the model says, and the difference between them."
        )
        if closed:
            lead += " With the effects, the blue difference should be no more than noise."
        if len(shown) < len(data.channels):
            lead += f" The {len(shown)} channels with the largest shares of the gap."
        svg = to_svg(plot_left_over(data, shown, closed), "curves", "Measured and modelled, before and after")
        plots = live_chart(
            "curves-plots", data.time, list(_curve_panels(data, shown, closed)), inline_figure(svg)
        )
        return html_section(self.identifier, self.title, lead, plots)


def _curve_panels(data: ForceComparison, channels: Sequence[str], closed: bool) -> Iterator[dict[str, Any]]:
    """Two panels a channel: measured and modelled, and their difference."""
    models: list[tuple[dict[str, Any], Array]] = [
        ({"label": "the model", "role": "nominal", "dash": [5, 3]}, data.nominal)
    ]
    if closed:
        models.append(({"label": "with the effects", "role": "identified"}, data.identified))
    for name in channels:
        i = data.channels.index(name)
        measured, unit = data.measured[:, i], data.units[i]
        lines: list[tuple[dict[str, Any], Array]] = [({"label": "measured", "role": "ink"}, measured)]
        lines += [(line, values[:, i]) for line, values in models]
        yield {"title": f"{channel_label(name)} [{unit}]", "unit": unit, "series": lines}
        left = [(line, measured - values[:, i]) for line, values in models]
        yield {
            "title": f"{channel_label(name)}, measured less modelled [{unit}]",
            "unit": unit,
            "series": left,
        }
