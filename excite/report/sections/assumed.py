"""What no file said of the robot, and what follows from the values taken for it."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import html_section, html_table
from excite.report.sections.section import Section


class Assumed(Section):
    """Everything that the robot's description assumed."""

    identifier = "assumed"
    title = "Assumed"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        source = findings.plan or findings.refusals or findings.check or {}
        rows = [(one["what"], one["value"], one["consequence"]) for one in source.get("assumed", [])]
        if not rows:
            return ""
        lead = (
            "Neither the model nor its maker's files say these things of the robot. What the page finds safe is safe "
            "as far as they hold: state in robot.yaml what is known better, take it out of the list assumed there, and "
            "plan again."
        )
        return html_section(
            self.identifier, self.title, lead, html_table(("what", "taken", "what follows"), rows)
        )
