"""The report's section on the masses of the segments."""

from __future__ import annotations

import numpy as np

from excite.report.comparisons import MassComparison
from excite.report.folder import Findings
from excite.report.html import Cell, folded_content, html_section, html_table, inline_figure
from excite.report.plots.masses import plot_masses
from excite.report.sections.section import Section
from excite.report.theme import to_svg


class Masses(Section):
    """Nominal, identified and, on a virtual robot, true masses."""

    identifier = "masses"
    title = "Masses"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        data = findings.data.masses
        if data is None:
            return ""
        lead = "Where the blue bar leaves the pale one, the robot is not the model that was supplied"
        lead += (
            "; the green tick is the truth, which only a virtual robot tells."
            if data.true is not None
            else "."
        )
        if data.half_width is not None:
            lead += (
                " Lines are 95 % intervals of the data and of what the nominal model is granted together: where the "
                "data tell little of a mass by itself, as of neighbours whose sum they tell, it is as wide as that."
            )
        if data.changed is not None and data.changed.any():
            names = [name for name, changed in zip(data.names, data.changed, strict=True) if changed]
            lead += (
                " In bold, the fewest segments that, changed in mass, centre of mass or inertia, explain what the "
                f"nominal model leaves: {', '.join(names)}. A robot whose bodies all differ a little shows itself so "
                "too; Differences lists what the data tell of each parameter by itself."
            )
        svg = to_svg(plot_masses(data), "masses", "Mass of each segment: nominal, identified, true")
        return html_section(
            self.identifier,
            self.title,
            lead,
            inline_figure(svg),
            folded_content("Numbers", _mass_numbers(data)),
        )


def _mass_numbers(data: MassComparison) -> str:
    columns = {"nominal [kg]": data.nominal, "identified [kg]": data.identified}
    sums = {name: float(np.sum(column)) for name, column in columns.items()}
    if data.half_width is not None:
        columns["± 95 % [kg]"] = data.half_width
    if data.determined is not None:
        columns["told by the data [%]"] = 100.0 * data.determined
    if data.true is not None:
        columns["true [kg]"] = data.true
        sums["true [kg]"] = float(np.sum(data.true))
    rows: list[tuple[Cell, ...]] = [
        (name, *(float(column[i]) for column in columns.values())) for i, name in enumerate(data.names)
    ]
    # Masses of neighbours are known together, so that their intervals do not add up.
    return html_table(["segment", *columns], rows, ("all", *(sums.get(name, "") for name in columns)))
