"""Recordings of real arms: how well runs that were not used are predicted."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from excite.identification.identify import identify
from excite.logs.robot import nominal_robot
from tests.benchmarks.table import Row
from tests.reproduction.recordings import ur10e_log
from tests.reproduction.test_panda import ALPHA, BY_HAND, TERMS, validation_rmse
from tests.reproduction.test_ur10e import LARGEST_PERCENT, SETTINGS

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def rows() -> list[Row]:
    """UR10e and Panda; a row that says so where the recordings are not there."""
    if not DATA.is_dir():
        return [Row("recordings of real arms", "", f"not found in {DATA}; set EXCITE_DATA", None)]
    with tempfile.TemporaryDirectory() as name:
        return [*_ur10e(Path(name)), *_panda(Path(name))]


def _ur10e(folder: Path) -> list[Row]:
    log = ur10e_log(DATA, folder)
    found = identify(nominal_robot(log), log, "qp", problem_settings=SETTINGS)
    percent = [100.0 * fit.rmse / fit.std for fit in found.validation.values()]
    text = " ".join(f"{value:.1f}" for value in percent) + " %"
    what = "UR10e: validation residual by joint, share of torque standard deviation (5 Hz)"
    return [Row.holds(what, f"≤ {LARGEST_PERCENT:g} % each", text, max(percent) <= LARGEST_PERCENT)]


def _panda(folder: Path) -> list[Row]:
    rmse = validation_rmse("map", TERMS, ALPHA, folder, DATA)
    text = " ".join(f"{value:.3f}" for value in rmse)
    asked = " ".join(f"{value:g}" for value in BY_HAND)
    share = rmse.sum() / BY_HAND.sum()
    return [
        Row.holds("Panda: last third by joint, RMSE [N·m] (5 Hz)", f"≤ {asked}", text, bool((rmse <= BY_HAND).all())),
        Row.at_most("Panda: total, share of least squares by hand", float(share), 0.9),
    ]

