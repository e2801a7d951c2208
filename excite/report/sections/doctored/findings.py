"""What is wrong with a log, worst first, and what was done or is to be done about it."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, html_section, html_table
from excite.report.sections.section import Section

_MEANS = {
    "fatal": "nothing can be told",
    "spoils": "spoils what is computed",
    "limits": "limits what can be told",
    "note": "to know",
}
# Named places and trials.
_NAMED = 4


class LogFindings(Section):
    """A row a finding."""

    identifier = "findings"
    title = "Findings"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.doctor
        if found is None:
            return ""
        if not found["findings"]:
            lead = "Rows, clock, units, signs, order of columns, zeros, dead and clipped channels: nothing is wrong."
            return html_section(self.identifier, self.title, lead)
        lead = (
            "Worst first. What is mended here is mended for excite identify and excite diagnose too, which look the "
            "log through in the same way; the log itself is as it was."
        )
        if found["repaired"]:
            lead += f" A mended copy is in {found['repaired']}."
        headers = ["how bad", "what was found", "what was done, or is to be done", "where"]
        rows = [_finding_row(item) for item in found["findings"]]
        if any(item["sure"] < 1.0 for item in found["findings"]):
            headers.append("sure")
            rows = [
                (*row, f"{100.0 * item['sure']:.0f} %")
                for row, item in zip(rows, found["findings"], strict=True)
            ]
        return html_section(self.identifier, self.title, lead, html_table(headers, rows))


def _finding_row(item: Document) -> tuple[Cell, ...]:
    state = "mended" if item["repaired"] else _MEANS[item["severity"]]
    where = _list_places(item["places"])
    if item["trials"]:
        where += f"{'; ' if where else ''}in {_list_places(item['trials'])}"
    return state, item["text"], item["remedy"], where


def _list_places(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
