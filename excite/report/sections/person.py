"""The report's section on a person: segment masses beside the tables', and the ground reaction."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, format_number, html_section, html_table
from excite.report.sections.section import Section

_ROLES = {"validation": "trials that were left out", "identification": "trials that were identified from"}


class Person(Section):
    """De Leva's and Dumas' masses beside those that were identified, and how well the ground reaction is predicted."""

    identifier = "person"
    title = "Person"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        human = findings.human
        if human is None:
            return ""
        lead = (
            "Masses of the segments by two tables of the literature, beside those that the ground reaction tells; "
            "± is one standard deviation of motions and table together, and where it is as large as the mass, motions "
            "did not tell it."
        )
        return html_section(
            self.identifier, self.title, lead, _mass_table(human, findings), _reaction_table(human)
        )


def _mass_table(human: Document, findings: Findings) -> str:
    found = (findings.identification or {}).get("standard_parameters", {})
    headers = ["segment", "de Leva 1996 [kg]", "Dumas 2007 [kg]"] + (["identified [kg]"] if found else [])
    rows: list[tuple[Cell, ...]] = []
    for item in human["segments"]:
        row: tuple[Cell, ...] = (item["segment"], item["de_leva_kg"], item["dumas_kg"])
        block = next(
            (
                block
                for block in found.values()
                if block.get("name") == item["segment"] and block["nominal_mass"]
            ),
            None,
        )
        if found:
            row = (*row, "–" if block is None else _with_deviation(block))
        rows.append(row)
    return html_table(headers, rows)


def _with_deviation(block: Document) -> str:
    std = (block.get("std") or {}).get("mass")
    return format_number(block["mass"]) + ("" if std is None else f" ± {format_number(std, 2)}")


def _reaction_table(human: Document) -> str:
    parts = []
    for role, words in _ROLES.items():
        fits = (human.get("ground_reaction") or {}).get(role)
        if not fits:
            continue
        rows: list[tuple[Cell, ...]] = [
            (
                f"{name} [{fit['unit']}]",
                fit["rmse"],
                format_number(fit["cc"]),
                fit["reference_rmse"],
                format_number(fit["reference_cc"]),
            )
            for name, fit in fits.items()
        ]
        headers = ["ground reaction", "RMSE identified", "correlation", "RMSE nominal", "correlation"]
        parts.append(f"<h3>Ground reaction, {words}</h3>" + html_table(headers, rows))
    return "".join(parts)
