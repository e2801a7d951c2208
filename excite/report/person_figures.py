"""Figures and report data of an identified person, beside the log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.human.identified import IdentifiedPerson
from excite.human.plates.ground_reaction import AXES, UNITS
from excite.human.segment_table import STATED, SegmentTable
from excite.report.comparisons import NORMAL_95, ForceComparison, MassComparison
from excite.report.data import ReportData, save_report_data
from excite.report.plots.segment_masses import save_force_figure, save_segment_figure

MASSES, REACTION = "segment_masses.png", "ground_reaction.png"


def save_person_figures(found: IdentifiedPerson, wearing: SegmentTable | None, table: str, out: Path) -> None:
    """Write the masses as bars, the ground reaction of the last trial as curves, and what `excite report` reads.

    Args:
        found: what was identified.
        wearing: masses from trials with a weight, None without any.
        table: of the nominal masses.
        out: log folder.
    """
    rows = found.table.rows
    names = [row.segment for row in rows]
    nominal = [row.nominal.get(STATED, row.nominal[table]) for row in rows]
    identified = [row.identified for row in rows]
    heavier = None if wearing is None else [row.identified for row in wearing.rows]
    save_segment_figure(names, nominal, identified, out / MASSES, heavier)
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
    save_force_figure(curves, out / REACTION)
    known = [row.std for row in rows if row.std is not None]
    half_width = NORMAL_95 * np.array(known) if len(known) == len(rows) else None
    masses = MassComparison(tuple(names), np.array(nominal), np.array(identified), half_width=half_width)
    save_report_data(ReportData(forces=curves, masses=masses), out / "report_data.npz")
