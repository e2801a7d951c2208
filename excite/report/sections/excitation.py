"""How well the chosen motions excite each segment."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import condition, figure, folded, number, paragraph, section, table
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
            content.append(figure(draw_conditioning(change).to_svg("Condition number of each segment")))
        if plan is not None:
            full, log_det = number(condition(plan["full"])), number(plan["log_det"])
            numbers = f"the condition number is {full}, the log-determinant of the information {log_det}."
            content.append(paragraph(f"Over all {plan['n_base_parameters']} base parameters {numbers}"))
            rows = [(row["segment"], condition(row["condition"])) for row in plan["segments"]]
            listing = table(("segment", "condition number"), rows)
            content.append(folded("Condition number of each segment", listing))
        return section(self.identifier, self.title, lead, *content)
