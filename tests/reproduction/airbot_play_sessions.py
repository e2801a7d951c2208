"""AirBot Play, six joints: nine recordings of five motions, four of them run twice."""

from __future__ import annotations

from pathlib import Path

from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.recordings import import_recordings

FOLDER = "airbot_play_multi_traj"
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
# Motions recorded once and again; the last was recorded once.
MOTIONS = ("vali_ga_N12T25", "vali_opt", "vali_ptrnSrch_N7T25QR-5", "vali_ptrnSrch_N7T25QR-6")
FIRST = (*MOTIONS, "vali_ptrnSrch_N8T25QR")
AGAIN = tuple(f"{motion}_rep2" for motion in MOTIONS)


def airbot_log(
    data_dir: Path, folder: Path, identification: tuple[str, ...], validation: tuple[str, ...] = ()
) -> Log:
    """Recordings by name; each is a session of its own."""
    source = data_dir / FOLDER
    roles = {**dict.fromkeys(identification, "identification"), **dict.fromkeys(validation, "validation")}
    mapping = {
        "log": {
            "robot": "airbot_play.urdf",
            "base": "fixed",
            "rate_hz": 195,
            "joints": JOINTS,
            "torque": "motor_side",
        },
        "columns": {
            "time": "t_s",
            "q.{joint}": "q{n}_rad",
            "v.{joint}": "qd{n}_radps",
            "tau.{joint}": "tau{n}_Nm",
            "q_cmd.{joint}": "qdes{n}_rad",
        },
        "trials": [
            {"file": f"{name}.csv", "role": role, "name": name, "session": name} for name, role in roles.items()
        ],
    }
    urdf = (source / "play.urdf").read_text()
    log = import_recordings(mapping, source, robot_text=urdf)
    return load_log(save_log(log, folder / "airbot_sessions"))
