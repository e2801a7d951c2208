"""Figures and report data of an identified person, beside the log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.human.identified import IdentifiedPerson
from excite.human.plates import AXES, UNITS
from excite.human.segment_table import STATED, SegmentTable
from excite.report.comparisons import NORMAL_95, ForceComparison, MassComparison, ReportData, save_report_data
from excite.report.plots.bars import Bars, draw_bars
from excite.report.plots.curves import channel_panels, draw_panels
from excite.report.theme import save_png

MASSES, REACTION = "segment_masses.png", "ground_reaction.png"


def save_person_figures(found: IdentifiedPerson, wearing: SegmentTable | None, table: str, out: Path) -> None:
    """Write the masses as bars, the ground reaction of the last trial as curves, and what `excite report` reads.

    Bars are those of figures 10 to 13 of Jovic et al., T-RO 2016, curves those of figures 8 and 9.

    Args:
        found: what was identified.
        wearing: masses from trials with a weight, None without any.
        table: of the nominal masses.
        out: log folder.
    """
    rows = found.table.rows
    names = tuple(row.segment for row in rows)
    nominal = np.array([row.nominal.get(STATED, row.nominal[table]) for row in rows])
    identified = np.array([row.identified for row in rows])
    bars = Bars(
        [name.replace("right_", "R ").replace("left_", "L ").replace("_", " ") for name in names],
        nominal,
        identified,
        ("by table", "identified", "with the weight"),
        "mass [kg]; identified in per cent of the table's",
        texts=[f"{share:.0f} %" for share in 100.0 * identified / nominal],
        ticks=None if wearing is None else np.array([row.identified for row in wearing.rows]),
    )
    save_png(draw_bars(bars), out / MASSES)
    shown = found.reactions[-1]
    curves = ForceComparison(
        trial=f"{shown.trial} ({shown.role})",
        channels=AXES,
        units=UNITS,
        time=shown.time,
        measured=shown.measured,
        nominal=shown.nominal,
        identified=shown.identified,
    )
    save_png(draw_panels(curves.time, channel_panels(curves)), out / REACTION)
    known = [row.std for row in rows if row.std is not None]
    half_width = NORMAL_95 * np.array(known) if len(known) == len(rows) else None
    masses = MassComparison(names, nominal, identified, half_width=half_width)
    save_report_data(ReportData(forces=curves, masses=masses), out / "report_data.npz")
