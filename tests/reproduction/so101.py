"""SO-101 desktop arm: recordings of positions and commands of hobby servos, with what a bench says of their gain.

Recordings: isaac-sim2real/sage (Apache-2.0). Model: SO-ARM100 (TheRobotStudio), as packed in example-robot-data.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.robot.catalogue import example_robot_data
from tests.reproduction.imported import import_recordings
from tests.reproduction.recordings_data import DATA

# The recordings' names of the model's joints; the jaw, whose reading is no angle, stays where it is.
JOINTS = {
    "shoulder_pan": "Rotation",
    "shoulder_lift": "Pitch",
    "elbow_flex": "Elbow",
    "wrist_flex": "Wrist_Pitch",
    "wrist_roll": "Wrist_Roll",
}
# Motions that a position servo can follow; steps and random binary commands run into its limits of speed.
FITTED = ("backlash_detection", "chirp_sweep", "friction_gravity", "single_joint_elbow")
JUDGED = ("multisine",)
# Firmware gain as recorded; duty per rad and unit of gain, torque per volt: Duclusaud et al., Extended Friction
# Models for the Physics Simulation of Servo Actuators, ICRA 2025, published with its code for this servo.
FIRMWARE_GAIN, DUTY, VOLTS, TORQUE_PER_VOLT = 16.0, 0.166, 12.0, 1.178 / 2.479
KP = FIRMWARE_GAIN * DUTY * VOLTS * TORQUE_PER_VOLT


def so101_log(data_dir: Path, folder: Path) -> Log:
    """The log of the arm without its jaw: gains of position stated, those of velocity not."""
    roles = {**dict.fromkeys(FITTED, "identification"), **dict.fromkeys(JUDGED, "validation")}
    mapping = {
        "log": {
            "robot": "robot.urdf",
            "base": "fixed",
            "gravity": [0.0, 0.0, -9.81],
            "rate_hz": 49.86,
            "joints": tuple(JOINTS.values()),
            "torque": "none",
            "controller": {
                "mode": "position",
                "kp": dict.fromkeys(JOINTS.values(), KP),
                "feedforward": "none",
            },
            "modelled": ["rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature"],
        },
        "columns": {"time": "time", "q.{joint}": "q.{joint}", "q_cmd.{joint}": "q_cmd.{joint}"},
        "trials": [{"file": f"{name}.parquet", "role": role} for name, role in roles.items()],
    }
    log = import_recordings(mapping, data_dir / "so101_sage", robot_text=_model())
    return load_log(save_log(log, folder / "so101"))


def _model() -> str:
    """The model with the recordings' names, without shapes, its jaw fixed."""
    text = (example_robot_data() / "so_arm_description" / "urdf" / "so101.urdf").read_text(encoding="utf-8")
    text = re.sub(r"<(visual|collision)>.*?</\1>|<transmission.*?</transmission>", "", text, flags=re.DOTALL)
    for theirs, ours in JOINTS.items():
        text = text.replace(f'joint name="{theirs}"', f'joint name="{ours}"')
    return text.replace('joint name="gripper" type="revolute"', 'joint name="gripper" type="fixed"')


if __name__ == "__main__":
    # python -m tests.reproduction.so101 FOLDER: writes the log there; then: excite diagnose FOLDER/so101
    so101_log(DATA, Path(sys.argv[1]))
