"""What the gap is counted from: sizes that the model took from the record before the first effect was asked for."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, format_number, html_paragraph, html_section, html_table
from excite.report.sections.section import Section
from excite.shown import span

_BODIES = {
    "rigid_body": "The bodies' base parameters were fitted to this record, too.",
    "rigid_body_fixed": "The bodies are as the model has them.",
}


class Baseline(Section):
    """A row a joint and parameter, with its interval."""

    identifier = "baseline"
    title = "What the baseline was fitted to"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None or not found["baseline"]:
            return ""
        lead = (
            "The gap is what is left with these sizes, which the record decided before any effect was asked for: "
            "what they have taken up is no effect. Beside the accepted effects they may come out otherwise."
        )
        bodies = [html_paragraph(text) for word, text in _BODIES.items() if word in found["modelled"]]
        headers = ("joint", "parameter", "value", "±", "90 % interval", "unit")
        return html_section(
            self.identifier,
            self.title,
            lead,
            html_table(headers, [_baseline_row(item) for item in found["baseline"]]),
            *bodies,
        )


def _baseline_row(item: Document) -> tuple[Cell, ...]:
    bounds = item["interval90"]
    between = "–" if bounds is None else span(format_number(bounds[0]), format_number(bounds[1]), " to ")
    name = item["parameter"].replace("_", " ")
    return item["joint"], name, item["value"], item["std"], between, item["unit"]
