"""How well the models predict what the sensors measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from excite.report.comparisons import ForceComparison
from excite.report.data import ReportData
from excite.report.folder import Findings
from excite.report.html import Cell, html_section, html_table, inline_figure
from excite.report.live import live_chart
from excite.report.plots.forces import MOST_PANELS, channel_label, plot_forces
from excite.report.sections.section import Section
from excite.report.theme import to_svg

# Of wrenches in documents that do not say it.
_UNITS = {"f": "N", "t": "N·m"}


class Forces(Section):
    """Measured, nominal and identified on one trial; RMSE and correlation of all trials."""

    identifier = "forces"
    title = "Prediction of forces"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        data = _from_zero(findings.data)
        identification = findings.identification or {}
        blocks = [
            (
                "Cross validation (trials that the identification has not seen)",
                identification.get("validation"),
            ),
            ("Direct validation (trials that it was identified from)", identification.get("fit")),
        ]
        tables = [f"<h3>{title}</h3>{_fit_table(rows)}" for title, rows in blocks if rows]
        if data is None and not tables:
            return ""
        content = []
        lead = "RMSE should fall and correlation rise from the nominal to the identified model."
        if data is not None:
            lead = (
                f"On {data.trial}, which the identification has not seen, the blue line of the identified "
                "model should cover the measured one, and the dashed nominal one should not."
            )
            if findings.human is not None and tables:
                lead += (
                    " The curves are the ground reaction in the laboratory's axes, with moments about a point on the "
                    "ground below the pelvis, as under Person; the tables are of the same wrench in the pelvis' axes, "
                    "about its origin, as it was fitted: other figures of the same trials."
                )
            if len(data.channels) > MOST_PANELS:
                lead += f" Drawn are the first {MOST_PANELS} of {len(data.channels)} channels."
            svg = to_svg(plot_forces(data), "forces", "Measured and predicted forces of a validation trial")
            content.append(
                live_chart("forces-plots", data.time, list(_force_panels(data)), inline_figure(svg))
            )
        return html_section(self.identifier, self.title, lead, *content, *tables)


def _from_zero(data: ReportData) -> ForceComparison | None:
    """The curves with the trial's own time, by which it is shown in motion; a record's clock may start anywhere."""
    forces, path = data.forces, data.path
    if forces is None:
        return None
    same = path is not None and path.trial == forces.trial
    return replace(forces, time=forces.time - (path.time[0] if path is not None and same else forces.time[0]))


def _force_panels(data: ForceComparison) -> Iterator[dict[str, Any]]:
    for i, name in enumerate(data.channels[:MOST_PANELS]):
        series = [
            ({"label": "measured", "role": "ink"}, data.measured[:, i]),
            ({"label": "nominal model", "role": "nominal", "dash": [5, 3]}, data.nominal[:, i]),
            ({"label": "identified model", "role": "identified"}, data.identified[:, i]),
        ]
        unit = data.units[i]
        yield {"title": f"{channel_label(name)} [{unit}]", "unit": unit, "series": series}


def _fit_table(channels: dict[str, dict[str, Any]]) -> str:
    rows: list[tuple[Cell, ...]] = []
    for channel, row in channels.items():
        before, after = row["reference_rmse"], row["rmse"]
        known = bool(before) and after is not None
        change = f"{100.0 * (after - before) / before:+.0f} %".replace("-", "−") if known else "–"
        unit = row["unit"] or _UNITS.get(channel[:1] if len(channel) == 2 else "", "")
        rows.append((channel_label(channel), unit, before, after, change, row["reference_cc"], row["cc"]))
    headers = (
        "channel",
        "unit",
        "RMSE nominal",
        "RMSE identified",
        "change",
        "correlation nominal",
        "correlation identified",
    )
    return html_table(headers, rows)
