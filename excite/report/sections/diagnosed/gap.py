"""The gap of each channel against its noise floor, before and after the effects."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import Cell, folded_content, html_section, html_table, inline_figure
from excite.report.plots.gap import plot_gap
from excite.report.sections.section import Section
from excite.report.theme import to_svg


class GapByChannel(Section):
    """Bars from the noise floor upwards; the numbers, with those of roll-outs."""

    identifier = "gap"
    title = "Gap by channel"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None:
            return ""
        channels = found["gap"]["per_channel"]
        closed = bool(found["effects"])
        lead = (
            "What the model leaves on trials that were not fitted, as a multiple of the noise floor: bars that end at "
            "the line leave nothing to explain."
        )
        svg = to_svg(plot_gap(channels, closed), "gap", "Gap of each channel over its noise floor")
        rows: list[tuple[Cell, ...]] = [
            (name, item["unit"], item["before"], item["after"] if closed else None, item["noise_floor"])
            for name, item in channels.items()
        ]
        numbers = folded_content(
            "Numbers", html_table(("channel", "unit", "before", "after", "noise floor"), rows)
        )
        return html_section(
            self.identifier,
            self.title,
            lead,
            inline_figure(svg),
            numbers,
            _rollout_sentence(found["simulation"]),
        )


def _rollout_sentence(simulation: dict | None) -> str:
    if simulation is None or not simulation["before"]:
        return ""
    after, floor = simulation["after"], simulation["floor"]
    rows: list[tuple[Cell, ...]] = [
        (name, _times_thousand(before), _times_thousand(after[name]), _times_thousand(floor.get(name)))
        for name, before in simulation["before"].items()
    ]
    how = f"{simulation['horizon_s']:g} s, driven by {simulation['driven_by']}"
    summary = f"Roll-outs of {how}: errors [mrad or mm]"
    return folded_content(summary, html_table(("channel", "before", "after", "what noise alone makes"), rows))


def _times_thousand(value: float | None) -> float | None:
    return None if value is None else 1e3 * value
