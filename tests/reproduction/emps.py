"""EMPS, a carriage on a ball screw: its mass and friction beside those that its authors publish.

Janot, Gautier, Brunot: Data set and reference models of EMPS. Workshop on Nonlinear System Identification
Benchmarks, Eindhoven 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.imported import import_recordings

JOINT = "slide"
NEWTON_PER_VOLT = 35.15065188248547
# A horizontal slide; the mass is a round guess, which least squares does not use.
URDF = f"""<robot name="emps">
  <link name="frame"/>
  <link name="carriage">
    <inertial><mass value="100"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{JOINT}" type="prismatic">
    <parent link="frame"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-0.05" upper="0.3" effort="{10 * NEWTON_PER_VOLT:.1f}" velocity="0.5"/>
  </joint>
</robot>
"""

# Kinematics pass five times, rows twice the natural frequency of the position loop (see :func:`loop_hz`), so that
# what the servo does to the carriage stays and what lies above is noise. The axis changes direction within
# milliseconds and never stands for a quarter of a second, so no sample is left out; its slowest stretch runs at
# 42 mm/s, and the encoder resolves 50 nm: friction changes sign with the velocity itself, not over a band.
SETTINGS = ProblemSettings(cutoff_hz=40.0, kinematics_cutoff_hz=100.0, coulomb_width=0.0)


@dataclass(frozen=True)
class Published:
    """A parameter: name of its base parameter here, value from 24.8 s, by hand from these 16 s, tolerance."""

    what: str
    name: str
    value: float
    by_hand: float
    percent: float | None


PUBLISHED = (
    Published("mass [kg]", "m(carriage)", 95.1089, 94.90, 0.5),
    Published("viscous friction [N·s/m]", f"viscous({JOINT})", 203.5034, 197.2, 4.0),
    Published("Coulomb friction [N]", f"coulomb({JOINT})", 20.3935, 20.78, 2.5),
    Published("offset [N]", f"offset({JOINT})", -3.1648, -3.04, None),
)


def emps_log(data_dir: Path, folder: Path, split: float = 1.0) -> Log:
    """The 16 s of the recording, voltages as forces; a first part of this share trains, the rest judges."""
    file = "emps_train_t0_16s.csv"
    trials = [{"file": file, "role": "identification", "part": [0.0, split]}]
    if split < 1.0:
        trials.append({"file": file, "role": "validation", "name": "rest", "part": [split, 1.0]})
    mapping = {
        "log": {
            "robot": "emps.urdf",
            "base": "fixed",
            "rate_hz": 1000,
            "joints": [JOINT],
            "torque": "motor_side",
        },
        "columns": {
            "time": "t_s",
            "q.{joint}": "qm_meas_m",
            "q_cmd.{joint}": "qg_ref_m",
            "tau.{joint}": "vir_V",
        },
        "scale": {"tau.{joint}": NEWTON_PER_VOLT},
        "trials": trials,
    }
    log = import_recordings(mapping, data_dir / "emps_ballscrew_axis", robot_text=URDF)
    return load_log(save_log(log, folder / "emps"))


def identified(log: Log) -> Identification:
    """Least squares with :data:`SETTINGS`; the rotor's inertia is part of the mass, as in the publication."""
    return identify(nominal_robot(log), log, "wls", problem_settings=SETTINGS)


def loop_hz(log: Log, mass: float) -> float:
    """Natural frequency of the position loop [Hz]: force per tracking error, fitted to the log, over the mass."""
    trial = log.trials[0]
    assert trial.q_cmd is not None
    assert trial.tau is not None
    velocity = np.gradient(trial.q[:, 0], trial.time)
    columns = np.column_stack([trial.q_cmd[:, 0] - trial.q[:, 0], velocity, np.ones(trial.n_samples)])
    stiffness = np.linalg.lstsq(columns, trial.tau[:, 0], rcond=None)[0][0]
    return float(np.sqrt(stiffness / mass) / (2.0 * np.pi))
