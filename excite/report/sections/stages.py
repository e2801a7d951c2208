"""How long each stage of the plan took."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import Cell, html_section, html_table
from excite.report.sections.section import Section


class Stages(Section):
    """Seconds by stage."""

    identifier = "stages"
    title = "Time taken"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        stages = (findings.plan or {}).get("stages")
        if not stages:
            return ""
        rows: list[tuple[Cell, ...]] = [
            (entry["stage"], round(float(entry["seconds"]), 2)) for entry in stages
        ]
        total = ("all", sum(float(entry["seconds"]) for entry in stages))
        lead = "The plan's stages in the order in which they ran."
        return html_section(self.identifier, self.title, lead, html_table(("stage", "time [s]"), rows, total))
