"""How well the chosen motions excite each segment."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import (
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_section,
    html_table,
    inline_figure,
)
from excite.report.plots.conditioning import draw_conditioning
from excite.report.sections.section import Section


class Excitation(Section):
    """Condition numbers of the segments, before and after where both are known."""

    identifier = "excitation"
    title = "Excitation"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        plan = (findings.plan or {}).get("conditioning")
        change = findings.data.conditioning
        if plan is None and change is None:
            return ""
        lead = "The shorter a bar, the more evenly the motions excite that segment's ten inertial parameters."
        content = []
        if change is not None:
            content.append(
                inline_figure(draw_conditioning(change).to_svg("Condition number of each segment"))
            )
        if plan is not None:
            full, log_det = format_number(condition_value(plan["full"])), format_number(plan["log_det"])
            numbers = f"the condition number is {full}, the log-determinant of the information {log_det}."
            content.append(html_paragraph(f"Over all {plan['n_base_parameters']} base parameters {numbers}"))
            rows = [(row["segment"], condition_value(row["condition"])) for row in plan["segments"]]
            listing = html_table(("segment", "condition number"), rows)
            content.append(folded_content("Condition number of each segment", listing))
        return html_section(self.identifier, self.title, lead, *content)
