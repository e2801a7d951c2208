"""AirBot Play, six joints: the same chirps without and with a load."""

from __future__ import annotations

from pathlib import Path

from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.recordings import import_recordings

FOLDER = "airbot_play_load_pair"
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
# What the authors' configuration says of the load [kg]; nobody says that it was weighed.
STATED_MASS = 0.48


def chirp_log(data_dir: Path, folder: Path, loaded: bool) -> Log:
    """One of the two recordings: the first two thirds train, the last third judges."""
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
            {"file": f"{name}.csv", "role": "identification", "name": "first", "part": [0.0, 2 / 3]},
            {"file": f"{name}.csv", "role": "validation", "name": "last", "part": [2 / 3, 1.0]},
        ],
    }
    urdf = (source / "airbot_play_v3_0_gripper.urdf").read_text()
    log = import_recordings(mapping, source, robot_text=urdf)
    return load_log(save_log(log, folder / name))
