"""What to measure next, what was wrong with the record, and the limits of what was said."""

from __future__ import annotations

from html import escape

from excite.report.folder import Findings
from excite.report.html import Cell, html_paragraph, html_section, html_table
from excite.report.sections.section import Section


class Record(Section):
    """The next experiment, faults of the log and notes, each only where there is something to say."""

    identifier = "record"
    title = "What to do, and what to keep in mind"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None:
            return ""
        content, following = [], found["next_experiment"]
        if following is not None:
            motion = f" The motion is in {following['motion']}." if following["motion"] else ""
            content.append(html_paragraph(f"Next: {following['why']}{motion}"))
        if found["log"]:
            rows: list[tuple[Cell, ...]] = [
                (item["what"], item["cause"], "repaired" if item["repaired"] else "left as it is")
                for item in found["log"]
            ]
            content.append(
                "<h3>Faults of the record</h3>"
                + html_table(("what", "what was done, or is to be done", ""), rows)
            )
        said = {item["what"] for item in found["log"]}
        notes = [*found["warnings"], *((found["simulation"] or {"warnings": ()})["warnings"])]
        notes = [text for text in notes if text not in said]
        if notes:
            content.append(
                "<h3>Limits</h3><ul>" + "".join(f"<li>{escape(text)}</li>" for text in notes) + "</ul>"
            )
        if not content:
            return ""
        return html_section(self.identifier, self.title, "", *content)
