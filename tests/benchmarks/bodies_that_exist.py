"""``cls3`` on every recording and virtual robot: whether each identified body can exist, recomputed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.identification.estimators.conic import Cls3Settings, DensityRealisable
from excite.identification.identify import identify
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.robot.catalogue import bundled_robots
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.benchmarks.table import Row
from tests.identification.practice_log import arm_log
from tests.identification.synthetic import wrench_problem
from tests.reproduction import airbot_play_load, airbot_play_sessions, emps, human_2020, lwr, tiago, tx40
from tests.reproduction.recordings import panda_log, ur10e_log
from tests.reproduction.test_ur10e import SETTINGS as UR10E

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
LEAST = -1e-9
PLAIN = ProblemSettings(cutoff_hz=5.0)
LOGS: dict[str, tuple[Callable[[Path, Path], Log], ProblemSettings]] = {
    "UR10e": (ur10e_log, UR10E),
    "Panda": (panda_log, PLAIN),
    "EMPS": (emps.emps_log, emps.SETTINGS),
    "LWR": (lambda data, folder: lwr.lwr_log(data, folder, lwr.HALF), lwr.SETTINGS),
    "TX40": (tx40.tx40_log, tx40.SETTINGS),
    "TIAGo's arm": (tiago.tiago_log, PLAIN),
    "AirBot Play": (
        lambda data, folder: airbot_play_sessions.airbot_log(data, folder, airbot_play_sessions.FIRST),
        PLAIN,
    ),
    "AirBot Play without load": (lambda data, folder: airbot_play_load.chirp_log(data, folder, False), PLAIN),
    "AirBot Play with load": (lambda data, folder: airbot_play_load.chirp_log(data, folder, True), PLAIN),
}


def rows() -> list[Row]:
    """Least eigenvalue of all pseudo-inertias of each data set."""
    with tempfile.TemporaryDirectory() as name:
        return [*_recordings(Path(name)), *_virtual()]


def _recordings(folder: Path) -> Iterator[Row]:
    if not DATA.is_dir():
        yield Row("cls3 on recordings", "", f"not found in {DATA}; set EXCITE_DATA", None)
        return
    for name, (make, settings) in LOGS.items():
        log = make(DATA, folder / name)
        yield _row(
            name,
            lambda log=log, settings=settings: (
                identify(nominal_robot(log), log, "cls3", problem_settings=settings).parameters
            ),
        )
    person = human_2020.Recording(DATA, folder / "person")
    instants = np.arange(person.n_instants)
    yield _row("person on a force plate", lambda: person.estimate(instants, "cls3"))


def _virtual() -> Iterator[Row]:
    """Robots that differ from their models: arms by up to 10 % in masses and moments, humanoids by 5 % in mass."""
    for name in bundled_robots():
        robot = load_robot(name)
        if robot.floating:
            problem = wrench_problem(robot, 1.05 * robot.nominal_parameters, seed=0, trials=2, duration=8.0)
            yield _row(
                f"virtual {name}",
                lambda problem=problem: DensityRealisable().estimate(problem, Cls3Settings()).parameters,
            )
        else:
            log = arm_log(robot, 0, trials=3)
            yield _row(
                f"virtual {name}",
                lambda robot=robot, log=log: identify(robot, log, "cls3", problem_settings=PLAIN).parameters,
            )


def _row(name: str, parameters: Callable[[], np.ndarray]) -> Row:
    what = f"cls3, {name}: least eigenvalue of a pseudo-inertia"
    try:
        ten = parameters()
    except ExciteError as error:
        return Row.holds(what, f"≥ {LEAST:g}", str(error), False)
    return Row.at_least(what, least_eigenvalue(ten), LEAST)


def least_eigenvalue(parameters: np.ndarray) -> float:
    """Of ``[[½ tr(I) 1 − I, h], [hᵀ, m]]`` of all bodies, written out from the ten parameters of each."""
    least = np.inf
    for m, hx, hy, hz, xx, xy, yy, xz, yz, zz in parameters.reshape(-1, 10):
        second = np.array(
            [[(yy + zz - xx) / 2, -xy, -xz], [-xy, (xx + zz - yy) / 2, -yz], [-xz, -yz, (xx + yy - zz) / 2]]
        )
        pseudo = np.block([[second, np.array([[hx], [hy], [hz]])], [np.array([[hx, hy, hz, m]])]])
        least = min(least, float(np.linalg.eigvalsh(pseudo)[0]))
    return least
