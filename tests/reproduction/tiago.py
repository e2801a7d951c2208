"""PAL TIAGo, torso lift and arm of seven joints: motor currents of the arm's first four joints."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from excite.arrays import Array
from excite.formats.registry import format_of
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.problem import build_problem
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.robot.catalogue import example_robot_data
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.imported import import_recordings
from tests.reproduction.recordings import percent_left

FOLDER = "tiago_arm_figaroh"
JOINTS = ("torso_lift_joint", *(f"arm_{i}_joint" for i in range(1, 8)))
# The lift's current is in a unit nobody states, those of the wrist are the noise of a reading of zero.
NO_TORQUE = ("torso_lift_joint", "arm_5_joint", "arm_6_joint", "arm_7_joint")
# Gear ratio times torque constant, as the recordings' authors publish them [N·m/A].
GAINS = {"arm_1_joint": 13.6, "arm_2_joint": 13.6, "arm_3_joint": -8.7, "arm_4_joint": -8.7}
# The rows that the authors use; before and after them the robot stands or is brought there.
ROWS = slice(921, 6791)
# What plain least squares by hand leaves of the currents' deviation on these rows, joints 1 to 4 [%].
BY_HAND = (18, 22, 16, 11)
_FILES = (("position", "q"), ("velocity", "v"), ("effort", "i"))


def tiago_log(data_dir: Path, folder: Path, split: float = 2 / 3) -> Log:
    """The authors' rows: a first part of this share trains, the rest judges; all train where it is 1."""
    with tempfile.TemporaryDirectory() as name:
        _join(data_dir / FOLDER, Path(name) / "tiago.parquet")
        trials = [{"role": "identification", "name": "first", "part": [0.0, split]}]
        if split < 1.0:
            trials.append({"role": "validation", "name": "last", "part": [split, 1.0]})
        mapping = {
            "log": {
                "robot": "tiago.urdf",
                "base": "fixed",
                "rate_hz": 100,
                "joints": JOINTS,
                "torque": "current",
                "torque_constants": GAINS,
                "no_torque": NO_TORQUE,
            },
            "columns": {"time": "time", **{f"{p}.{{joint}}": f"{p}.{{joint}}" for _, p in _FILES}},
            "trials": [{"file": "tiago.parquet"} | trial for trial in trials],
        }
        urdf = example_robot_data() / "tiago_description" / "robots" / "tiago.urdf"
        log = import_recordings(mapping, Path(name), robot_text=urdf.read_text())
        return load_log(save_log(log, folder / "tiago"))


def percents(log: Log, role: str = "validation", method: str = "qp") -> Array:
    """What trials of a role leave of the torques' deviation after identification, ``(4,)`` [%].

    Default settings but for the delay of the drives' currents, which is what the identification trials say.
    """
    robot = nominal_robot(log)
    settings = ProblemSettings(torque_delay_s=_find_delay(robot, log))
    problem = build_problem(robot, log, settings)
    estimate = find_estimator(method).estimate(problem, estimator_settings(method))
    return percent_left(build_problem(robot, log, settings, role=role), estimate.parameters)


def _find_delay(robot: Robot, log: Log) -> float:
    """How late torques are [s]: where least squares leave least of the identification trials."""

    def left_of(delay: float) -> float:
        problem = build_problem(robot, log, ProblemSettings(torque_delay_s=delay))
        rows, measured = problem.Y * problem.weights[:, None], problem.y * problem.weights
        rest = measured - rows @ np.linalg.lstsq(rows, measured, rcond=1e-10)[0]
        return float(rest @ rest / (measured @ measured))

    return float(minimize_scalar(left_of, bounds=(-0.06, 0.06), method="bounded", options={"xatol": 1e-4}).x)


def _join(source: Path, target: Path) -> None:
    """Three tables of the same stamps as one."""
    columns = {}
    for kind, prefix in _FILES:
        table = np.loadtxt(source / f"tiago_{kind}.csv", delimiter=",", skiprows=1)[ROWS]
        columns["time"] = table[:, 0]
        columns |= {f"{prefix}.{joint}": table[:, 1 + k] for k, joint in enumerate(JOINTS)}
    format_of(target).write(columns, target)
