"""UR10e: currents of a run that was not used, and a load weighed with gains found from the pair of logs."""

from __future__ import annotations

from pathlib import Path

from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.load import weigh_load
from excite.identification.problem import build_problem
from excite.logs.robot import nominal_robot
from tests.reproduction.recordings import UR10E_GAINS, UR10E_JOINTS, percent_left, ur10e_log
from tests.reproduction.recordings_data import from_recordings
from tests.reproduction.table import Line, Table
from tests.reproduction.test_ur10e import LARGEST_PERCENT, SETTINGS
from tests.reproduction.ur10e_load import MASS, PLAIN, run_of_14_harmonics

_TITLE = "Mamedov and Mikhel 2020: UR10e"


def tables() -> list[Table]:
    """Validation and load."""
    return from_recordings(_TITLE, _tables)


def _tables(data: Path, folder: Path) -> list[Table]:
    return [_validation(data, folder), _load(data, folder)]


def _validation(data: Path, folder: Path) -> Table:
    log = ur10e_log(data, folder)
    robot = nominal_robot(log)
    problem = build_problem(robot, log, SETTINGS)
    judge = build_problem(robot, log, SETTINGS, role="validation")
    lines = []
    for method in ("wls", "map"):
        found = find_estimator(method).estimate(problem, estimator_settings(method)).parameters
        for joint, ours in zip(UR10E_JOINTS, percent_left(judge, found), strict=True):
            met = bool(ours <= LARGEST_PERCENT)
            bar = f"≤ {LARGEST_PERCENT:g}"
            lines.append(Line(f"{method}, {joint}", bar, float(ours), met, bar))
    note = (
        "Identified from the runs of 20 to 50 s, judged on the run of 14 harmonics: RMS of measured minus predicted"
        " in percent of the torque's standard deviation, 5 Hz on both sides."
    )
    return Table(f"{_TITLE}, a run not used", tuple(lines), note, digits=3)


def _load(data: Path, folder: Path) -> Table:
    bare = run_of_14_harmonics(data, folder, "bare", {"identification": (0.0, 1.0)}, load=False)
    halves = [
        run_of_14_harmonics(data, folder, name, {"identification": span}, load=True)
        for name, span in (("first", (0.0, 0.5)), ("second", (0.5, 1.0)))
    ]
    robot = nominal_robot(bare)
    lines, found = [], []
    for known, judged, name in ((halves[1], halves[0], "first"), (halves[0], halves[1], "second")):
        gains = weigh_load(robot, bare, known, mass=MASS, settings=PLAIN).gains
        mass = weigh_load(robot, bare, judged, gains=gains, settings=PLAIN).mass
        what = f"load [kg], {name} half, gains from the other half"
        lines.append(Line(what, MASS, mass, abs(mass / MASS - 1.0) < 0.03, "within 3 %"))
        found.append(gains)
    published = weigh_load(robot, bare, halves[1], gains=UR10E_GAINS, settings=PLAIN).mass
    lines.append(Line("load [kg], second half, published gains", MASS, published))
    lines += [Line(f"gain of {joint} [N·m/A]", UR10E_GAINS[joint], found[0][joint]) for joint in UR10E_JOINTS]
    return Table(
        f"{_TITLE}, a load of known mass", tuple(lines), "The run of 14 harmonics, bare and loaded.", digits=4
    )
