"""KUKA LWR 4+ with joint torque sensors, as published with FloBaRoID: two trajectories, one of them poor.

Bethge, Malzahn, Tsagarakis, Caldwell: FloBaRoID, a software package for the identification of robot dynamics
parameters. RAAD 2017.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.finding import Finding
from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.imported import import_recordings

LWR_JOINTS = tuple(f"lwr_{i}_joint" for i in range(7))

# The motions turn below 1 Hz. Sensors behind the gears read friction of bearings and seals, zeros that drift, and
# some tenths of a per cent of the moments that bend them; a base that is not level looks like that too.
PLAIN = ProblemSettings(cutoff_hz=5.0, drive_terms=("viscous", "coulomb", "offset"))
SETTINGS = ProblemSettings(cutoff_hz=5.0, drive_terms=("viscous", "coulomb", "offset", "bending"))

# What base parameters by hand leave [N·m]: of the second of two runs of one trajectory, identified from the first and
# another trajectory, each joint and joint 2; and of joint 2 of the other trajectory from both runs of the one.
LARGEST, LARGEST_2 = 0.3, 0.29
OTHER_TRAJECTORY_2 = 1.0

HALF = (
    {"run": 1, "role": "identification", "part": (0.0, 0.5)},
    {"run": 3, "role": "identification"},
    {"run": 1, "role": "validation", "part": (0.5, 1.0)},
)
"""Half a run and the other trajectory train, the other half judges; the run that repeats it is not public."""

OTHER = ({"run": 1, "role": "identification"}, {"run": 3, "role": "validation"})
"""One poor trajectory trains, the other judges."""

BOTH = ({"run": 1, "role": "identification"}, {"run": 3, "role": "identification"})
"""Both train."""


def lwr_log(data_dir: Path, folder: Path, trials: tuple[dict[str, Any], ...]) -> Log:
    """Parts of the two recordings as a log; the recorder's targets run on another clock and are left out."""
    source = data_dir / "kuka_lwr4_flobaroid"
    mapping = {
        "log": {
            "robot": "kuka_lwr4.urdf",
            "base": "fixed",
            "rate_hz": 200,
            "joints": LWR_JOINTS,
            "torque": "link_side",
        },
        "columns": {"time": "times", "q.{joint}": "positions.{n}", "tau.{joint}": "torques.{n}"},
        "trials": [_entry(number, **trial) for number, trial in enumerate(trials)],
    }
    log = import_recordings(mapping, source, robot_text=(source / "kuka_lwr4.urdf").read_text())
    return load_log(save_log(log, folder / "lwr"))


def _entry(number: int, run: int, role: str, part: tuple[float, float] = (0.0, 1.0)) -> dict[str, Any]:
    file = f"measurements_{run}.npz"
    return {"file": file, "role": role, "name": f"run_{run}_{number}", "part": part}


def found(log: Log, method: str, settings: ProblemSettings = SETTINGS) -> Identification:
    """The log identified with the data set's settings."""
    return identify(nominal_robot(log), log, method, problem_settings=settings)


def left(result: Identification) -> Array:
    """Root mean square of measured minus predicted on the validation trials, ``(7,)`` [N·m]."""
    return np.array([fit.rmse for fit in result.validation.values()])


def unexcited(result: Identification) -> Finding:
    """The finding on directions that the data do not excite."""
    return next(item for item in result.findings if item.kind == "unexcited")
