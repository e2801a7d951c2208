"""AirBot Play, six joints: nine recordings of five motions, four of them run twice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt
from scipy.stats import norm

from excite.arrays import Array
from excite.formats.registry import format_of
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.problem import build_problem
from excite.identification.sessions import Sessions, identify_sessions, split_sessions
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction.imported import import_recordings
from tests.reproduction.recordings import percent_left

FOLDER = "airbot_play_multi_traj"
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
# Motions recorded once and again; the last was recorded once.
MOTIONS = ("vali_ga_N12T25", "vali_opt", "vali_ptrnSrch_N7T25QR-5", "vali_ptrnSrch_N7T25QR-6")
FIRST = (*MOTIONS, "vali_ptrnSrch_N8T25QR")
# Most that plain least squares by hand on four motions leaves of the others' torques [% of their deviation].
BY_HAND = (45.0, 10.0, 10.0, 45.0, 45.0, 45.0)
AGAIN = tuple(f"{motion}_rep2" for motion in MOTIONS)


def airbot_log(
    data_dir: Path, folder: Path, identification: tuple[str, ...], validation: tuple[str, ...] = ()
) -> Log:
    """Recordings by name; a motion is a session, with both of its recordings.

    What the model lacks comes back with the motion, so recordings of one are not independent sessions.
    """
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
            {"file": f"{name}.csv", "role": role, "name": name, "session": name.removesuffix("_rep2")}
            for name, role in roles.items()
        ],
    }
    urdf = (source / "play.urdf").read_text()
    log = import_recordings(mapping, source, robot_text=urdf)
    return load_log(save_log(log, folder / "airbot_sessions"))


def waves_a_turn(data_dir: Path, joint: int) -> tuple[float, float]:
    """Periods a turn of the torque that comes back with a joint's position, and its size [N·m], by hand.

    Of the four motions' second recordings, whose torques are less filtered than the first ones': what is above 1.5 Hz
    while the joint is slow, projected on waves of the position; medians over the recordings.

    Args:
        data_dir: folder of the recordings.
        joint: its number, from one.
    """
    periods, found = np.arange(20.0, 420.0, 0.5), []
    for name in AGAIN:
        rows = format_of(data_dir / FOLDER / f"{name}.csv").read(data_dir / FOLDER / f"{name}.csv").columns
        time, q, tau = rows["t_s"], rows[f"q{joint}_rad"], rows[f"tau{joint}_Nm"]
        v = np.gradient(q, time)
        fast = filtfilt(*butter(4, 1.5, "high", fs=1.0 / float(np.median(np.diff(time)))), tau)
        slow = (np.abs(v) > 0.01) & (np.abs(v) < 0.6)
        size = 2.0 * np.abs(np.exp(-1j * np.outer(periods, q[slow])) @ fast[slow]) / slow.sum()
        found.append((periods[np.argmax(size)], size.max()))
    best = np.median(found, axis=0)
    return float(best[0]), float(best[1])


def percents(data_dir: Path, folder: Path, method: str = "qp") -> Array:
    """What all other recordings leave after four motions, ``(6,)`` [%]; default settings."""
    log = airbot_log(data_dir, folder, MOTIONS, (FIRST[-1], *AGAIN))
    robot = nominal_robot(log)
    estimate = find_estimator(method).estimate(build_problem(robot, log), estimator_settings(method))
    return percent_left(build_problem(robot, log, role="validation"), estimate.parameters)


def pooled(data_dir: Path, folder: Path) -> Sessions:
    """All nine recordings as sessions."""
    log = airbot_log(data_dir, folder, (*FIRST, *AGAIN))
    return identify_sessions(nominal_robot(log), split_sessions([log]))


@dataclass(frozen=True)
class LeftOut:
    """How often intervals hold what a motion shows that they were not made from.

    Attributes:
        n_motions: that were left out in turn.
        share: of all base parameters and motions.
        share_without_between: the same where the pooled mean's own interval is taken, as if nothing but noise
            differed.
    """

    n_motions: int
    share: float
    share_without_between: float


def motions_left_out(data_dir: Path, folder: Path) -> LeftOut:
    """Leave out one motion in turn, and hold its estimates, noise allowed for, against 95 % intervals."""
    log = airbot_log(data_dir, folder, (*MOTIONS, *AGAIN))
    robot, all_sessions = nominal_robot(log), split_sessions([log])
    whole = identify_sessions(robot, all_sessions)
    reach = float(norm.ppf(0.975))
    held, held_without = [], []
    for number, motion in enumerate(whole.names):
        rest = identify_sessions(robot, {name: item for name, item in all_sessions.items() if name != motion})
        if rest.base.labels != whole.base.labels:
            raise ValueError("base parameters differ")
        value, std = whole.values[number], whole.std[number]
        middle = rest.pooled.next_interval.mean(axis=0)
        held.append(np.abs(value - middle) < reach * np.hypot(rest.pooled.next_std, std))
        narrow = np.hypot(std, 1.0 / np.sqrt((1.0 / rest.std**2).sum(axis=0)))
        center = (rest.values / rest.std**2).sum(axis=0) / (1.0 / rest.std**2).sum(axis=0)
        held_without.append(np.abs(value - center) < reach * narrow)
    return LeftOut(len(held), float(np.mean(held)), float(np.mean(held_without)))
