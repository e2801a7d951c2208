"""EMPS: the published model of a ball-screw axis beside ours, with 95 % intervals."""

from __future__ import annotations

from pathlib import Path

from tests.reproduction.emps import PUBLISHED, SETTINGS, emps_log, identified, loop_hz
from tests.reproduction.recordings_data import from_recordings
from tests.reproduction.table import Line, Table

_TITLE = "Janot, Gautier, Brunot 2019: EMPS, IDIM-LS"
# Share of the force's deviation left of the whole 24.8 s by plain least squares by hand.
_RESIDUAL_BY_HAND = 3.9


def tables() -> list[Table]:
    """Mass, friction and offset."""
    return from_recordings(_TITLE, _tables)


def _tables(data: Path, folder: Path) -> list[Table]:
    log = emps_log(data, folder)
    found = identified(log)
    base = {item.name: item for item in found.base}
    lines = []
    for item in PUBLISHED:
        ours = base[item.name]
        value, half = ours.value, ours.half_width_95 or 0.0
        what = f"{item.what} (plain least squares by hand on the same 16 s: {item.by_hand:g})"
        if item.percent is None:
            lines.append(Line(what, item.value, value))
        else:
            met = abs(value / item.value - 1.0) <= item.percent / 100.0
            lines.append(Line(what, item.value, value, met, f"within {item.percent:g} %"))
        inside = abs(value - item.value) <= half
        interval = f"{value - half:.4g} … {value + half:.4g}"
        lines.append(Line(f"{item.what}, 95 % interval", f"{item.value:.4g}", interval, inside, "holds it"))
    fit = next(iter(found.fit.values()))
    lines.append(Line("residual, % of the force's deviation", _RESIDUAL_BY_HAND, 100.0 * fit.rmse / fit.std))
    band = loop_hz(log, base[PUBLISHED[0].name].value)
    lines.append(Line("natural frequency of the position loop, from this log [Hz]", None, band))
    note = (
        "The paper has 24.8 s, the public file 16 s; the intervals tell how far the shorter one may be off."
        f" Kinematics pass {SETTINGS.kinematics_cutoff_hz:g} Hz, rows {SETTINGS.cutoff_hz:g} Hz, five times and twice"
        " the natural frequency of the position loop; friction changes sign with the velocity, no sample is left out."
    )
    return [Table(_TITLE, tuple(lines), note)]
