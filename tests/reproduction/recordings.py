"""How public recordings map onto logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.robot.catalogue import example_robot_data
from tests.reproduction.imported import import_recordings

UR10E_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
# Torque per ampere as the recordings' authors publish it (Mamedov and Mikhel, Front. Robot. AI 2020) [N·m/A].
UR10E_GAINS = dict(zip(UR10E_JOINTS, (14.87, 13.26, 11.13, 10.62, 11.03, 11.47), strict=True))
PANDA_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))


def ur10e_log(data_dir: Path, folder: Path) -> Log:
    """UR10e, Fourier motions: the runs of 20, 30, 40 and 50 s train, the run of 14 harmonics judges."""
    source = data_dir / "ur10e_dynamic_calibration"
    runs = ("05-20sec_8harm", "10-30sec_12harm", "12-40sec_12harm", "12-50sec_12harm")
    trials = [{"file": f"identification/ur-20_02_{run}.csv", "role": "identification"} for run in runs]
    mapping = {
        "log": {
            "robot": "ur10e.urdf",
            "base": "fixed",
            "rate_hz": 100,
            "joints": UR10E_JOINTS,
            "torque": "current",
            "torque_constants": UR10E_GAINS,
        },
        "columns": {
            "time": "t_s",
            "q.{joint}": "q{n}_rad",
            "v.{joint}": "qd{n}_radps",
            "i.{joint}": "i{n}_A",
        },
        "trials": [*trials, {"file": "identification/ur-20_02_19_14harm50sec.csv", "role": "validation"}],
    }
    log = import_recordings(mapping, source, robot_text=(source / "ur10e.urdf").read_text())
    return load_log(save_log(log, folder / "ur10e"))


def panda_log(data_dir: Path, folder: Path) -> Log:
    """Franka Panda (Gaz et al., RA-L 2019): the first two thirds train, the last third judges."""
    file = "panda_exciting_traj1_t0_14s.csv"
    mapping = {
        "log": {
            "robot": "panda.urdf",
            "base": "fixed",
            "rate_hz": 1000,
            "joints": PANDA_JOINTS,
            "torque": "link_side",
        },
        "columns": {
            "time": "t_s",
            "q.{joint}": "q{n}_rad",
            "v.{joint}": "qd{n}_radps",
            "tau.{joint}": "tau{n}_Nm",
        },
        "trials": [
            {"file": file, "role": "identification", "name": "first", "part": [0.0, 2 / 3]},
            {"file": file, "role": "validation", "name": "last", "part": [2 / 3, 1.0]},
        ],
    }
    urdf = example_robot_data() / "panda_description" / "urdf" / "panda.urdf"
    log = import_recordings(mapping, data_dir / "franka_panda_gaz2019", robot_text=urdf.read_text())
    return load_log(save_log(log, folder / "panda"))


def percent_left(judge: IdentificationProblem, parameters: Array) -> Array:
    """RMS of measured minus predicted in percent of measured standard deviation, by channel, ``(n_channels,)``."""
    residual = judge.residual(parameters)
    masks = [judge.rows_of(channel) for channel in judge.channel_names]
    return np.array([100.0 * np.sqrt(np.mean(residual[rows] ** 2)) / judge.y[rows].std() for rows in masks])
