"""AirBot Play, six joints: the same chirps without and with a load."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from excite.arrays import Array
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.load import weigh_load
from excite.identification.problem import build_problem
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.imported import import_recordings
from tests.reproduction.recordings import percent_left

FOLDER = "airbot_play_load_pair"
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
# Drives without friction that grows with the load.
PLAIN = ProblemSettings(drive_terms=("viscous", "coulomb", "offset", "armature"))
# What the authors' configuration says of the load [kg]; nobody says that it was weighed.
STATED_MASS = 0.48
# What plain least squares by hand leaves of the torques' deviation [%], and the load it finds [kg].
SMALLEST_BY_HAND, LARGEST_BY_HAND, MASS_BY_HAND = 6.0, 27.0, 0.39


def chirp_log(data_dir: Path, folder: Path, loaded: bool, split: float = 2 / 3) -> Log:
    """One of the two recordings: a first part of this share trains, the rest judges."""
    source = data_dir / FOLDER
    name = "chirp_loaded" if loaded else "chirp_unloaded"
    mapping = {
        "log": {
            "robot": "airbot_play.urdf",
            "base": "fixed",
            "rate_hz": 100,
            "joints": JOINTS,
            "torque": "motor_side",
        },
        "columns": {"time": "t_s", "q.{joint}": "q{n}_rad", "tau.{joint}": "tau{n}_Nm"},
        "trials": [
            {"file": f"{name}.csv", "role": "identification", "name": "first", "part": [0.0, split]},
            {"file": f"{name}.csv", "role": "validation", "name": "last", "part": [split, 1.0]},
        ],
    }
    urdf = (source / "airbot_play_v3_0_gripper.urdf").read_text()
    log = import_recordings(mapping, source, robot_text=urdf)
    return load_log(save_log(log, folder / name))


def percents(data_dir: Path, folder: Path, loaded: bool, method: str = "qp") -> Array:
    """What the last third leaves of the torques' deviation, ``(6,)`` [%]; default settings."""
    log = chirp_log(data_dir, folder, loaded)
    robot = nominal_robot(log)
    estimate = find_estimator(method).estimate(build_problem(robot, log), estimator_settings(method))
    return percent_left(build_problem(robot, log, role="validation"), estimate.parameters)


@dataclass(frozen=True)
class Weighed:
    """The load's mass [kg].

    Attributes:
        as_given: with the torques as they are logged.
        halves: of each half of the loaded run, torque scales taken from the other half and the stated mass.
        gains: true per logged torque by joint, from the whole of both runs and the stated mass.
        gains_std: their standard deviations.
    """

    as_given: float
    halves: tuple[float, float]
    gains: dict[str, float]
    gains_std: dict[str, float]


def weighed(data_dir: Path, folder: Path) -> Weighed:
    """Weigh the load with torques as given, and with scales from a part of the log that does not judge."""
    bare = chirp_log(data_dir, folder, loaded=False)
    full = chirp_log(data_dir, folder, loaded=True, split=0.5)
    robot = nominal_robot(bare)
    halves = [_trial(full, k) for k in (0, 1)]
    masses = []
    for known, judged in (halves, halves[::-1]):
        gains = weigh_load(robot, bare, known, mass=STATED_MASS, settings=PLAIN).gains
        masses.append(weigh_load(robot, bare, judged, gains=gains, settings=PLAIN).mass)
    whole = weigh_load(robot, bare, full, mass=STATED_MASS, settings=PLAIN)
    return Weighed(
        as_given=weigh_load(robot, bare, full, settings=PLAIN).mass,
        halves=(masses[1], masses[0]),
        gains=dict(whole.gains),
        gains_std=dict(whole.gains_std),
    )


def _trial(log: Log, number: int) -> Log:
    header = log.header.model_copy(update={"trials": log.header.trials[number : number + 1]})
    return replace(log, header=header, trials=log.trials[number : number + 1])
