"""Figures and report data of an identified person, beside the log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.atomic import atomic_path
from excite.human.identified import IdentifiedPerson
from excite.human.plates import AXES, UNITS
from excite.human.segment_table import STATED, SegmentTable
from excite.report.comparisons import NORMAL_95, ForceComparison, MassComparison, ReportData, save_report_data
from excite.report.plots.forces import plot_forces
from excite.report.theme import IDENTIFIED, INK, PALE, TRUE, draw_figure, to_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


# A person's segment masses by table and as identified, and where a weight was worn.

_WIDTH = 0.38


def plot_segment_masses(
    names: Sequence[str],
    nominal: Sequence[float],
    identified: Sequence[float],
    wearing: Sequence[float] | None = None,
) -> Figure:
    """Two bars a segment, as figures 10 to 13 of Jovic et al., T-RO 2016.

    Args:
        names: of the segments.
        nominal: masses by the table [kg].
        identified: masses identified, in per cent of nominal above their bars.
        wearing: masses identified from trials with a weight; what they are more stands on top.
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        places = np.arange(len(names))
        axes.bar(places - _WIDTH / 2, nominal, _WIDTH, color=PALE.light, label="by table")
        axes.bar(places + _WIDTH / 2, identified, _WIDTH, color=IDENTIFIED.light, label="identified")
        tops = np.maximum(nominal, identified)
        if wearing is not None:
            more = np.maximum(0.0, np.subtract(wearing, identified))
            label = "more with the weight"
            axes.bar(places + _WIDTH / 2, more, _WIDTH, bottom=identified, color=TRUE.light, label=label)
            tops = np.maximum(tops, identified + more)
        for place, top, ours, table in zip(places, tops, identified, nominal, strict=True):
            text = f"{100.0 * ours / table:.0f} %"
            axes.annotate(text, (place, top), (0, 2), textcoords="offset points", ha="center", fontsize=7)
        axes.set_ylabel("mass [kg]")
        short = [name.replace("right_", "R ").replace("left_", "L ").replace("_", " ") for name in names]
        axes.set_xticks(places, short, rotation=40, ha="right", color=INK.light)
        axes.grid(axis="x", visible=False)
        figure.legend(loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=3.4)


def save_segment_figure(
    names: Sequence[str],
    nominal: Sequence[float],
    identified: Sequence[float],
    path: Path,
    wearing: Sequence[float] | None = None,
) -> Path:
    """Write :func:`plot_segment_masses` as a PNG; appears only when complete."""
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(to_png(plot_segment_masses(names, nominal, identified, wearing)))
    return Path(path)


def save_force_figure(data: ForceComparison, path: Path) -> Path:
    """Write measured and predicted ground reaction (figures 8 and 9 there) as a PNG, likewise."""
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(to_png(plot_forces(data)))
    return Path(path)
