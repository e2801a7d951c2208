"""Recordings of real robots: published parameters, and how well what was not used is predicted."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from excite.identification.identify import identify
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.load import weigh_load
from excite.logs.robot import nominal_robot
from tests.benchmarks.table import Row
from tests.reproduction import airbot_play_load, airbot_play_sessions, emps, lwr, solo12, tiago, tx40
from tests.reproduction.human_2020 import Recording
from tests.reproduction.recordings import panda_log, ur10e_log
from tests.reproduction.test_panda import ALPHA, BY_HAND, TERMS, validation_rmse
from tests.reproduction.test_ur10e import LARGEST_PERCENT, SETTINGS
from tests.reproduction.ur10e_load import MASS, run_of_14_harmonics

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def rows() -> list[Row]:
    """Every recording; a row that says so where the recordings are not there."""
    if not DATA.is_dir():
        return [Row("recordings of real arms", "", f"not found in {DATA}; set EXCITE_DATA", None)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = (_ur10e, _ur10e_load, _panda, _emps, _lwr, _tx40, _tiago, _solo12, _airbot_play, _person)
        return [row for part in parts for row in part(folder)]


def _ur10e(folder: Path) -> list[Row]:
    log = ur10e_log(DATA, folder)
    found = identify(nominal_robot(log), log, "qp", problem_settings=SETTINGS)
    percent = [100.0 * fit.rmse / fit.std for fit in found.validation.values()]
    text = " ".join(f"{value:.1f}" for value in percent) + " %"
    what = "UR10e: validation residual by joint, share of torque standard deviation (5 Hz)"
    return [Row.holds(what, f"≤ {LARGEST_PERCENT:g} % each", text, max(percent) <= LARGEST_PERCENT)]


def _ur10e_load(folder: Path) -> list[Row]:
    """The load, by drives' gains from the other half of its run, each half in turn."""
    bare = run_of_14_harmonics(DATA, folder, "bare", {"identification": (0.0, 1.0)}, load=False)
    halves = [
        run_of_14_harmonics(DATA, folder, name, {"identification": part}, load=True)
        for name, part in (("first", (0.0, 0.5)), ("second", (0.5, 1.0)))
    ]
    found = [
        weigh_load(nominal_robot(bare), bare, judged, calibration=(known, MASS))
        for known, judged in (halves, halves[::-1])
    ]
    text = ", ".join(f"{item.mass:.3f} ± {item.half_width_95[0]:.3f}" for item in found)
    good = all(abs(item.mass - MASS) < item.half_width_95[0] <= 0.1 for item in found)
    return [
        Row.holds(
            "UR10e: load by gains from the other half of its run [kg]", f"{MASS}, inside, ± ≤ 0.1", text, good
        )
    ]


def _panda(folder: Path) -> list[Row]:
    rmse = validation_rmse("map", TERMS, ALPHA, folder, DATA)
    text = " ".join(f"{value:.3f}" for value in rmse)
    asked = " ".join(f"{value:g}" for value in BY_HAND)
    share = rmse.sum() / BY_HAND.sum()
    log = panda_log(DATA, folder / "default")
    fits = identify(nominal_robot(log), log).validation.values()
    default = " ".join(f"{fit.rmse:.3f}" for fit in fits)
    return [
        Row.holds(
            "Panda: last third by joint, RMSE [N·m] (5 Hz)", f"≤ {asked}", text, bool((rmse <= BY_HAND).all())
        ),
        Row("… by the default method", "", f"{default}, in all {sum(fit.rmse for fit in fits):.3f}", None),
        Row.at_most("Panda: total, share of least squares by hand", float(share), 0.9),
    ]


def _emps(folder: Path) -> list[Row]:
    base = {item.name: item for item in emps.identified(emps.emps_log(DATA, folder)).base}
    rows = []
    for item in emps.PUBLISHED:
        if item.percent is None:
            continue
        ours = base[item.name]
        half = ours.half_width_95 or 0.0
        reached = f"{ours.value:.4g} ± {half:.2g}"
        close = abs(ours.value / item.value - 1.0) <= item.percent / 100.0
        inside = abs(ours.value - item.value) <= half
        what = f"EMPS: {item.what}, 95 % interval"
        rows.append(
            Row.holds(what, f"{item.value:.4g}, {item.percent:g} %, inside", reached, close and inside)
        )
    return rows


def _lwr(folder: Path) -> list[Row]:
    rmse = lwr.left(lwr.found(lwr.lwr_log(DATA, folder, lwr.HALF), "cls3"))
    text = " ".join(f"{value:.3f}" for value in rmse)
    met = bool((rmse <= lwr.LARGEST).all() and rmse[1] <= lwr.LARGEST_2)
    what = "LWR: half a run left out by joint, RMSE [N·m] (5 Hz)"
    return [Row.holds(what, f"≤ {lwr.LARGEST:g}, joint 2 ≤ {lwr.LARGEST_2:g}", text, met)]


def _tx40(folder: Path) -> list[Row]:
    log = tx40.tx40_log(DATA, folder)
    found = identify(nominal_robot(log), log, "cls3", problem_settings=tx40.SETTINGS)
    percent = tx40.percent_left(found.fit)
    text = " ".join(f"{value:.1f}" for value in percent) + " %"
    what = "TX40, coupled wrist: residual by joint, share of torque standard deviation (20 Hz)"
    drives = tx40.drive_parameters(DATA, log)
    inside = sum(abs(item.value - item.published) <= item.half_width for item in drives)
    return [
        Row.holds(what, f"≤ {tx40.LARGEST_PERCENT:g} % each", text, max(percent) <= tx40.LARGEST_PERCENT),
        Row.at_least(
            f"TX40: published drive parameters of {len(drives)} in their 95 % intervals", inside, 16
        ),
    ]


def _tiago(folder: Path) -> list[Row]:
    percent = tiago.percents(tiago.tiago_log(DATA, folder))
    what = "TIAGo arm 1–4: last third by joint, share of torque standard deviation (5 Hz)"
    return [_below(what, np.round(percent), np.array(tiago.BY_HAND))]


def _solo12(folder: Path) -> list[Row]:
    fits = solo12.fits_left_out(DATA, folder).values()
    percent = [100.0 * fit.rmse / fit.reference_rmse for fit in fits]
    text = f"{min(percent):.0f} … {max(percent):.0f} %, median {np.median(percent):.0f} %"
    what = "Solo12 (log of a simulation, no force sensor): last thirds by joint, RMSE as share of the URDF's, 12 joints"
    return [Row.holds(what, "< 100 % each", text, max(percent) < 100.0)]


def _airbot_play(folder: Path) -> list[Row]:
    percent = airbot_play_sessions.percents(DATA, folder)
    what = (
        "AirBot Play: five recordings from four others, by joint, share of torque standard deviation (5 Hz)"
    )
    rows = [_below(what, percent, np.array(airbot_play_sessions.BY_HAND))]
    held = airbot_play_sessions.motions_left_out(DATA, folder).share
    what = "AirBot Play: share of a motion's parameters in the 95 % interval made from other motions"
    rows.append(Row.at_least(what, held, 0.9))
    halves = airbot_play_load.weighed(DATA, folder).halves
    worst = max(abs(mass / airbot_play_load.STATED_MASS - 1.0) for mass in halves)
    what = "AirBot Play: load stated as 0.48 kg, torque scales from the other half of the run"
    return [*rows, Row.at_most(what, 100.0 * worst, 10.0, "% off")]


def _person(folder: Path) -> list[Row]:
    recording = Recording(DATA, folder / "person")
    train, judge = recording.thirds(2)
    alpha = recording.chosen_alpha(train, "pullback")
    found = {
        "prior": recording.prior,
        "least squares": recording.estimate(train, "wls"),
        "pullback": recording.estimate(train, "lmi", alpha=alpha, regulariser="pullback"),
    }
    miss = {name: recording.misses(judge, phi) for name, phi in found.items()}
    ours = miss.pop("pullback")
    text = " ".join(f"{value:.1f}" for value in ours)
    bar = ", ".join(f"{name} {' '.join(f'{v:.1f}' for v in values)}" for name, values in miss.items())
    better = all(bool((ours < values).all()) for values in miss.values())
    least = float(np.linalg.eigvalsh(pseudo_inertia_matrices(found["pullback"]))[:, 0].min())
    what = "Person on a force plate: last third, pullback regularisation, RMSE [N·m, N·m, N]"
    return [
        Row.holds(what, f"below {bar}", text, better),
        Row.holds("Person: bodies that can exist", "all 16", f"least eigenvalue {least:.1e}", least > 0.0),
    ]


def _below(what: str, percent: np.ndarray, bars: np.ndarray) -> Row:
    asked = " ".join(f"{value:g}" for value in bars)
    text = " ".join(f"{value:.3g}" for value in percent)
    return Row.holds(what, f"≤ {asked} %", f"{text} %", bool((percent <= bars).all()))
