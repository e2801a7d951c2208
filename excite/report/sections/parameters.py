"""The base parameters, whether the standard ones are physical, and warnings."""

from __future__ import annotations

from excite.identification.judgement.poor import said_rsd
from excite.report.folder import Findings
from excite.report.html import Cell, Said, folded_content, html_paragraph, html_section, html_table
from excite.report.sections.section import Section

_CHECKS = {
    "mass_positive": "masses are positive",
    "inertia_positive_definite": "inertias are positive definite",
    "triangle_inequality": "inertias obey the triangle inequality",
    "pseudo_inertia_min_eigenvalue": "smallest eigenvalue of a pseudo-inertia",
}


class Parameters(Section):
    """Values with their uncertainty, behind a fold; warnings in the open."""

    identifier = "parameters"
    title = "Parameters"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        identification = findings.identification
        if identification is None:
            return ""
        lead = (
            f"Identified with method {identification['method']} from {identification['n_samples']} samples; "
            "a relative standard deviation (RSD) above 10 to 20 % means that the data hardly determine it."
        )
        warnings = [html_paragraph(text, "note") for text in identification["warnings"]]
        base = identification["base_parameters"]
        rows = [_parameter_row(item) for item in base]
        values = folded_content(
            f"{len(base)} base parameters",
            html_table(("base parameter (SI)", "value", "standard deviation", "RSD"), rows),
        )
        return html_section(
            self.identifier, self.title, lead, *warnings, _consistency_sentence(identification), values
        )


def _parameter_row(item: dict) -> tuple[Cell, ...]:
    rsd = item["rsd_percent"]
    return item["expression"], item["value"], item["std"], Said(rsd, said_rsd(rsd))


def _consistency_sentence(identification: dict) -> str:
    found = identification["consistency"] or {}
    rows: list[tuple[Cell, ...]] = [
        (label, found[name]) for name, label in _CHECKS.items() if found.get(name) is not None
    ]
    return html_table(("physical consistency of the standard parameters", ""), rows) if rows else ""
