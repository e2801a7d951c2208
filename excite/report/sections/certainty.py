"""How certain the base parameters became, iteration by iteration."""

from __future__ import annotations

from excite.identification.judgement.poor import said_rsd
from excite.report.folder import Findings
from excite.report.html import Said, folded_content, html_section, html_table, inline_figure
from excite.report.plots.rsd import plot_rsd
from excite.report.sections.section import Section
from excite.report.theme import to_svg
from excite.shown import count


class Certainty(Section):
    """Relative standard deviations per iteration, and which parameters miss the target."""

    identifier = "certainty"
    title = "Certainty"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        if findings.campaign is None or not findings.campaign["iterations"]:
            return ""
        campaign = findings.campaign
        iterations = campaign["iterations"]
        target = campaign["target_rsd_percent"]
        lead = (
            "Each point is one base parameter: with every iteration the points should sink, and those that "
            "stay above their target are the ones that new motions are made for, where more motion can help."
        )
        plot = plot_rsd(iterations, target)
        last = iterations[-1]
        missed = sorted(last["not_met"], key=lambda name: -(last["rsd_percent"].get(name) or float("inf")))
        why = last["reasons"]
        deviations = [last["rsd_percent"].get(name) for name in missed]
        rows = [
            (name, Said(rsd, said_rsd(rsd)), why.get(name, ""))
            for name, rsd in zip(missed, deviations, strict=True)
        ]
        listing = folded_content(
            f"{count(len(missed), 'parameter')} above the target at the end",
            html_table(("base parameter", "RSD", "why"), rows),
        )
        svg = to_svg(plot, "rsd", "Relative standard deviation of each base parameter per iteration")
        return html_section(self.identifier, self.title, lead, inline_figure(svg), listing if missed else "")
