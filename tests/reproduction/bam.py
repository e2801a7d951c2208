"""Dynamixel XL330 with a pendulum: a known mass on a known arm, driven at three gains of the servo.

Duclusaud, Passault, Padois, Ly: Extended friction models for the physics simulation of servo actuators. ICRA 2025.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from excite.formats.registry import format_of
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from tests.reproduction.imported import import_recordings
from tests.reproduction.pendulum import pendulum_urdf

FOLDER = "bam_xl330_pendulum"
JOINT = "servo"
MASS, LENGTH = 0.49, 0.1
FULL_DUTY = 885.0
# Stall torque over voltage as the servo's maker states them [N·m/V].
TORQUE_PER_VOLT = 0.52 / 5.0
# Friction per load in the authors' model M3 of this servo, the plainest that has one.
PUBLISHED_LOAD_FRICTION = 0.122
MOTIONS = ("sin_sin", "sin_time_square", "up_and_down")
ROLES = {100: "identification", 800: "identification", 200: "validation"}
URDF = pendulum_urdf("xl330_pendulum", JOINT, MASS, LENGTH, effort=1.0, velocity=20.0)


def bam_log(data_dir: Path, folder: Path) -> Log:
    """Driven runs: the softest and the stiffest servo train, the one between judges.

    The torque is the motor's at standstill, duty times supply; what its speed takes off is viscous friction.
    """
    with tempfile.TemporaryDirectory() as name:
        trials = []
        for gain, role in ROLES.items():
            for motion in MOTIONS:
                file = f"{motion}_kp{gain}.parquet"
                _table(data_dir / FOLDER / f"{motion}_kp{gain}.json", Path(name) / file)
                trials.append({"file": file, "role": role})
        mapping = {
            "log": {
                "robot": "xl330_pendulum.urdf",
                "base": "fixed",
                "rate_hz": 188,
                "joints": [JOINT],
                "torque": "motor_side",
                "modelled": ["rigid_body", "viscous_friction", "coulomb_friction", "armature"],
            },
            "columns": {key: key for key in ("time", "q.{joint}", "q_cmd.{joint}", "tau.{joint}")},
            "trials": trials,
        }
        log = import_recordings(mapping, Path(name), robot_text=URDF)
        return load_log(save_log(log, folder / "bam"))


def _table(source: Path, target: Path) -> None:
    """One run as a table; counts of the duty are signed 16-bit numbers that were written as unsigned ones."""
    entries = json.loads(source.read_text())["entries"]
    values = {key: np.array([float(entry[key]) for entry in entries]) for key in entries[0]}
    duty = np.where(values["load"] > 32767.0, values["load"] - 65536.0, values["load"]) / FULL_DUTY
    columns = {
        "time": values["timestamp"],
        f"q.{JOINT}": values["position"],
        f"q_cmd.{JOINT}": values["goal_position"],
        f"tau.{JOINT}": TORQUE_PER_VOLT * duty * values["input_volts"],
    }
    format_of(target).write(columns, target)
