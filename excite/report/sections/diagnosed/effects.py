"""Effects in the order of their evidence: accepted ones, those as likely, those that were tried."""

from __future__ import annotations

from excite.diagnosis.answer.gap import closed_in_words, of_positions
from excite.report.folder import Document, Findings
from excite.report.html import Cell, format_number, html_paragraph, html_section, html_table
from excite.report.sections.section import Section

_PARAMETERS = 3


class Effects(Section):
    """Accepted effects with their sizes, then what the first of them was preferred to."""

    identifier = "effects"
    title = "Effects"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None or not (found["effects"] or found["candidates"]):
            return ""
        accepted = {(item["effect"], item["location"]) for item in found["effects"]}
        alike = {(item["effect"], item["location"]) for item in found["candidates"][: found["n_tied"]]}
        others = [c for c in found["candidates"] if (c["effect"], c["location"]) not in accepted]
        rows: list[tuple[Cell, ...]] = []
        for item in (*found["effects"], *others):
            key = (item["effect"], item["location"])
            standing = "as likely" if key in alike else "accepted" if key in accepted else "tried"
            rows.append(_effect_row(item, standing))
        headers = ("effect", "place", "", "evidence [nats]", "closed [%]", "size")
        lead = (
            "Evidence is a log-likelihood ratio over effective samples, less the price of the parameters and of the "
            "candidates tried: e to that power is by how much an effect is likelier than none."
        )
        units = (item["unit"] for item in found["gap"]["per_channel"].values())
        lead += f" {closed_in_words(of_positions(units)).capitalize()}."
        if not found["effects"]:
            lead += " None was accepted."
        tied = found["tied_locations"]
        places = (
            html_paragraph("Places that the record cannot tell apart: " + ", ".join(tied) + ".")
            if len(tied) > 1
            else ""
        )
        return html_section(self.identifier, self.title, lead, html_table(headers, rows), places)


def _effect_row(item: Document, standing: str) -> tuple[Cell, ...]:
    share = item["share_closed"]
    closed = None if share is None else round(100.0 * share)
    name = item["effect"].replace("_", " ")
    return (
        name,
        item["location"] or "",
        standing,
        item["evidence"],
        closed,
        _format_sizes(item["parameters"]),
    )


def _format_sizes(parameters: Document) -> str:
    said = []
    for name, entry in list(parameters.items())[:_PARAMETERS]:
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        spread = "" if entry["std"] is None else f" ± {format_number(entry['std'], 1)}"
        said.append(f"{name.replace('_', ' ')} {format_number(entry['value'], 4)}{spread}{unit}")
    more = len(parameters) - _PARAMETERS
    return "; ".join(said) + (f"; and {more} more" if more > 0 else "")
