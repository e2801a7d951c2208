"""The map of the gap: which channels, and what each one's follows."""

from __future__ import annotations

from html import escape

from excite.report.folder import Findings
from excite.report.html import html_section
from excite.report.plots.forces import channel_label
from excite.report.sections.section import Section


class Where(Section):
    """A row a channel, a column for each thing that its gap may follow; the fuller the colour, the more it does."""

    identifier = "where"
    title = "Where it lies"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None or not found["where"]:
            return ""
        lead = (
            "Before any effect is added. Each cell says what share of the channel's gap, on trials that were fitted, "
            "functions of that one thing would explain; several may look alike, and what does not hold on the trials "
            "that judge is no part of Where the gap goes. The band holds the middle 80 % of the gap's power."
        )
        what = list(dict.fromkeys(name for row in found["where"] for name in row["dependence"]))
        head = "".join(
            f"<th>{escape(text)}</th>"
            for text in (
                "channel",
                "share of the gap",
                *(name.replace("_", " ") for name in what),
                "band [Hz]",
            )
        )
        body = "".join(_where_row(row, what) for row in found["where"])
        map_ = f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        return html_section(self.identifier, self.title, lead, map_)


def _where_row(row: dict, what: list[str]) -> str:
    band = " to ".join("–" if end is None else f"{end:.2g}" for end in row["band_hz"])
    cells = "".join(_shaded_share(row["dependence"].get(name)) for name in what)
    return (
        f"<tr><td>{escape(channel_label(row['channel']))}</td>{_shaded_share(row['share'])}{cells}"
        f"<td>{band}</td></tr>"
    )


def _shaded_share(share: float | None) -> str:
    if share is None:
        return '<td class="map">–</td>'
    depth = round(60.0 * min(max(share, 0.0), 1.0))
    colour = f"color-mix(in srgb, var(--identified) {depth}%, transparent)"
    return f'<td class="map" style="background: {colour}">{100.0 * share:.0f} %</td>'
