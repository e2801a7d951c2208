"""What the signal processing did to one channel."""

from __future__ import annotations

from excite.logs.signals.trace import trace_from_json
from excite.report.folder import Findings
from excite.report.html import Cell, html_section, html_table, inline_figure
from excite.report.plots.signals import plot_signals
from excite.report.sections.section import Section
from excite.report.theme import to_svg


class Signals(Section):
    """One panel and one line a step."""

    identifier = "signals"
    title = "Signals"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        if findings.signals is None:
            return ""
        trace = trace_from_json(findings.signals)
        lead = (
            f"From the samples of {trace.channel} in {trace.trial}, as logged, to the rows of the regression: "
            "each panel is one step."
        )
        rows: list[tuple[Cell, ...]] = [
            (f"{number} {step.name}", step.effect) for number, step in enumerate(trace.steps, start=1)
        ]
        svg = to_svg(plot_signals(trace), "signals", "Each step of the signal processing, before and after")
        return html_section(
            self.identifier, self.title, lead, inline_figure(svg), html_table(("step", "what it did"), rows)
        )
