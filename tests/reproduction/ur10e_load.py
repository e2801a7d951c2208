"""UR10e with a tool load that its model lacks: a run that carries it against the model of the bare arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pinocchio as pin

from excite.arrays import Array
from excite.identification.identify import identify
from excite.identification.load import weigh_load
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.imported import import_recordings
from tests.reproduction.recordings import UR10E_GAINS, UR10E_JOINTS, ur10e_log

MASS = 2.805
"""Of the load, as the recordings' authors state it [kg]."""
SETTINGS = ProblemSettings(cutoff_hz=5.0)
PLAIN = replace(SETTINGS, drive_terms=("viscous", "coulomb", "offset", "armature"))
"""Drives without friction that grows with the load."""
_RUN = "identification/ur-20_02_19_14harm50sec"


def run_of_14_harmonics(
    data_dir: Path,
    folder: Path,
    name: str,
    parts: Mapping[str, tuple[float, float]],
    *,
    load: bool,
    header: Mapping[str, Any] | None = None,
) -> Log:
    """Parts of the run with 14 harmonics by role, without or with the load."""
    source = data_dir / "ur10e_dynamic_calibration"
    mapping = {
        "log": {
            "robot": "ur10e.urdf",
            "base": "fixed",
            "rate_hz": 100,
            "joints": UR10E_JOINTS,
            "torque": "current",
            **(header or {}),
        },
        "columns": {
            "time": "t_s",
            "q.{joint}": "q{n}_rad",
            "v.{joint}": "qd{n}_radps",
            "i.{joint}": "i{n}_A",
        },
        "trials": [
            {
                "file": f"{_RUN}{'Load' if load else ''}.csv",
                "role": role,
                "name": f"{name}_{role}",
                "part": part,
            }
            for role, part in parts.items()
        ],
    }
    log = import_recordings(mapping, source, robot_text=(source / "ur10e.urdf").read_text())
    return load_log(save_log(log, folder / name))


def loaded_log(data_dir: Path, folder: Path, gains: Mapping[str, float]) -> Log:
    """The second half of the loaded run, its first part to train on; the first half may weigh gains."""
    header = {
        "torque_constants": dict(gains),
        "modelled": [
            "rigid_body_fixed",
            "viscous_friction",
            "coulomb_friction",
            "armature",
            "torque_bias",
        ],
    }
    parts = {"identification": (0.5, 0.8), "validation": (0.8, 1.0)}
    return run_of_14_harmonics(data_dir, folder, "carried", parts, load=True, header=header)


def weighed_gains(data_dir: Path, folder: Path) -> dict[str, float]:
    """Torque constants that make the first half of the loaded run carry the stated mass [N·m/A]."""
    whole = {"identification": (0.0, 1.0)}
    bare = run_of_14_harmonics(data_dir, folder, "bare", whole, load=False)
    first = run_of_14_harmonics(data_dir, folder, "first", {"identification": (0.0, 0.5)}, load=True)
    return dict(weigh_load(nominal_robot(bare), bare, first, mass=MASS, settings=PLAIN).gains)


def bare_arm(data_dir: Path, folder: Path, gains: Mapping[str, float] = UR10E_GAINS) -> Robot:
    """The arm with inertial parameters identified from the four runs without load."""
    log = ur10e_log(data_dir, folder)
    robot = nominal_robot(log)
    settings = replace(SETTINGS, drive_gains=dict(gains))
    return with_inertials(robot, identify(robot, log, "lmi", problem_settings=settings).parameters)


def with_inertials(robot: Robot, parameters: Array) -> Robot:
    """The robot with other inertial parameters ``(10·n_segments,)``."""
    model = robot.model.copy()
    for joint, ten in enumerate(parameters.reshape(-1, 10), start=1):
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(ten)
    return replace(robot, model=model)
