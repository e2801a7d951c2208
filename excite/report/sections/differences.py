"""The table nominal → identified."""

from __future__ import annotations

from excite.export.models.differences import Difference, find_differences
from excite.report.folder import Findings
from excite.report.html import Cell, folded_content, html_paragraph, html_section, html_table
from excite.report.sections.section import Section

_HEADERS = ("link", "parameter", "nominal", "identified", "change", "±", "from data [%]")


class Differences(Section):
    """Parameters that clearly changed in the open, all of them behind a fold."""

    identifier = "differences"
    title = "Differences"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        identification = findings.identification or {}
        found = find_differences(identification.get("standard_parameters") or {})
        if not found.rows:
            return ""
        clear = [row for row in found.rows if row.clear]
        lead = (
            "Inertial parameters about the joint frames (SI), as supplied and as identified, with one standard "
            "deviation. Where little comes from data the value is the nominal model's and the constraints' "
            "choice: the motions, or the robot's joints, do not tell it from its neighbours'."
        )
        everything = folded_content(f"All {len(found.rows)} parameters", _differences_table(found.rows))
        if not clear:
            said = "No single parameter is determined by the data and more than two deviations off."
            return html_section(self.identifier, self.title, lead, html_paragraph(said), everything)
        said = (
            f"{len(clear)} of {len(found.rows)} were determined mostly by the data and moved by more than "
            "two standard deviations:"
        )
        strongest = sorted(clear, key=lambda row: -abs(row.change) / max(row.std or 0.0, 1e-300))[:20]
        chosen = [row for row in found.rows if row in strongest]
        return html_section(
            self.identifier, self.title, lead, html_paragraph(said), _differences_table(chosen), everything
        )


def _differences_table(rows: list[Difference] | tuple[Difference, ...]) -> str:
    cells: list[tuple[Cell, ...]] = []
    for row in rows:
        share = None if row.determined is None else 100.0 * row.determined
        name = f"{row.parameter} [{row.unit}]"
        cells.append((row.segment, name, row.nominal, row.identified, row.change, row.std, share))
    return html_table(_HEADERS, cells)
