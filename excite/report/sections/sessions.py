"""What several sessions of one robot agree on, and what changes between them."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, folded_content, format_number, html_paragraph, html_section, html_table
from excite.report.sections.section import Section
from excite.shown import span

# Sessions that have a column of their own in the table.
_COLUMNS = 6


class Sessions(Section):
    """Parameters that vary between sessions beyond their intervals in the open, all others behind a fold."""

    identifier = "sessions"
    title = "Sessions"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = (findings.identification or {}).get("sessions")
        if not found:
            return ""
        varying = [item for item in found["parameters"] if item["varies"]]
        count = f"{len(varying)} of {len(found['parameters'])}" if varying else "None"
        lead = (
            f"{count} of the base parameters differ{'s' if len(varying) == 1 else ''} between {len(found['names'])} "
            f"sessions ({', '.join(found['names'][:_COLUMNS])}) by more than their own intervals allow: friction that "
            "warms up, a load, a zero that was set anew."
        )
        if not varying:
            lead = lead.partition(":")[0] + "."
        notes = [
            html_paragraph(f"Left out: {name}, whose motions determine {own} of them.", "note")
            for name, own in found["left_out"].items()
        ]
        rest = [item for item in found["parameters"] if not item["varies"]]
        shown = [_sessions_table(varying, found)] if varying else []
        return html_section(
            self.identifier,
            self.title,
            lead,
            *notes,
            *shown,
            html_paragraph("ranges.yaml holds what the next session may bring, for domain randomisation."),
            folded_content(f"{len(rest)} that sessions agree on", _sessions_table(rest, found))
            if rest
            else "",
        )


def _sessions_table(parameters: list[Document], found: Document) -> str:
    names = found["names"][:_COLUMNS]
    rows: list[tuple[Cell, ...]] = [
        (
            item["name"],
            *(_session_value(item["by_session"].get(name)) for name in names),
            span(format_number(item["low"]), format_number(item["high"])),
        )
        for item in parameters
    ]
    level = f"the next lies in ({100 * found['level']:.0f} %)"
    return html_table(("base parameter (SI)", *names, level), rows)


def _session_value(found: Document | None) -> str:
    return "–" if found is None else f"{format_number(found['value'])} ± {format_number(found['std'], 2)}"
