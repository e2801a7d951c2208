"""TIAGo's arm: what plain least squares by hand leaves of the motor currents, beside ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.reproduction.recordings_data import from_recordings
from tests.reproduction.table import Line, Table
from tests.reproduction.tiago import BY_HAND, percents, tiago_log

_TITLE = "PAL TIAGo, arm joints 1 to 4 (recording published with FIGAROH)"


def tables() -> list[Table]:
    """Residuals by joint."""
    return from_recordings(_TITLE, _tables)


def _tables(data: Path, folder: Path) -> list[Table]:
    fitted = percents(tiago_log(data, folder / "whole", split=1.0), role="identification")
    split = tiago_log(data, folder / "split")
    judged, plain = percents(split), percents(split, method="wls")
    lines = []
    rows = zip(BY_HAND, fitted, judged, plain, strict=True)
    for joint, (by_hand, own, unseen, least_squares) in enumerate(rows, start=1):
        met = [bool(np.round(value) <= by_hand) for value in (own, unseen)]
        lines += [
            Line(f"joint {joint}, all rows fitted", by_hand, float(own), met[0], "≤ in whole per cent"),
            Line(
                f"joint {joint}, last third, not used", by_hand, float(unseen), met[1], "≤ in whole per cent"
            ),
            Line(f"joint {joint}, last third, plain least squares (`wls`)", None, float(least_squares)),
        ]
    note = (
        "RMS of measured minus predicted in percent of the torque's standard deviation. Authors' rows 921 to 6790"
        " and gains; `qp` with default filters (5 Hz on both sides) and the delay that the identification rows"
        " show. The lift's current (unit unknown) and the wrist's (a reading of zero) are declared `no_torque`."
    )
    return [Table(_TITLE, tuple(lines), note, digits=3)]
