"""What several sessions of one robot agree on, and what changes between them."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, folded, number, paragraph, section, table
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
            paragraph(f"Left out: {name}, whose motions determine {own} of them.", "note")
            for name, own in found["left_out"].items()
        ]
        rest = [item for item in found["parameters"] if not item["varies"]]
        shown = [_table(varying, found)] if varying else []
        return section(
            self.identifier,
            self.title,
            lead,
            *notes,
            *shown,
            paragraph("ranges.yaml holds what the next session may bring, for domain randomisation."),
            folded(f"{len(rest)} that sessions agree on", _table(rest, found)) if rest else "",
        )


def _table(parameters: list[Document], found: Document) -> str:
    names = found["names"][:_COLUMNS]
    rows: list[tuple[Cell, ...]] = [
        (
            item["name"],
            *(_value(item["by_session"].get(name)) for name in names),
            span(number(item["low"]), number(item["high"])),
        )
        for item in parameters
    ]
    level = f"the next lies in ({100 * found['level']:.0f} %)"
    return table(("base parameter (SI)", *names, level), rows)


def _value(found: Document | None) -> str:
    return "–" if found is None else f"{number(found['value'])} ± {number(found['std'], 2)}"
