"""The default method beside weighted least squares by hand: what is left of trials left out, and whether bodies exist.

By hand: Butterworth filters of scipy, regressor of pinocchio, friction and offset of every joint (and rotor inertia
where torques are the motors'), rounds of weights, minimum norm; nothing of the project but the reader of the log.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.signal import butter, filtfilt

from excite.identification.identify import identify
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.benchmarks.table import Row
from tests.reproduction import airbot_play_load, airbot_play_sessions, emps, lwr, tiago, tx40
from tests.reproduction.recordings import panda_log, ur10e_log

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
_CUTOFF_HZ, _RATE_HZ, _WIDTH = 5.0, 10.0, 0.01


def rows() -> list[Row]:
    """Sum over joints of the error on trials left out, default method / by hand, and whether all bodies can exist."""
    if not DATA.is_dir():
        return [Row("recordings of real arms", "", f"not found in {DATA}; set EXCITE_DATA", None)]
    found = []
    with tempfile.TemporaryDirectory() as name:
        for title, log in _logs(Path(name)):
            result = identify(nominal_robot(log), log)
            ours = sum(fit.rmse for fit in result.judgement.validation.values())
            ratio = ours / by_hand(log).sum()
            found.append(
                Row.at_most(f"{title}: default method / least squares by hand, trials left out", ratio, 1.0)
            )
            bad = result.judgement.consistency.inconsistent
            found.append(Row.holds("… bodies that cannot exist", "none", ", ".join(bad) or "none", not bad))
    return found


def _logs(folder: Path) -> list[tuple[str, Log]]:
    play = airbot_play_load.chirp_log
    return [
        ("UR10e", ur10e_log(DATA, folder / "a")),
        ("Panda", panda_log(DATA, folder / "b")),
        ("LWR 4+, half a run", lwr.lwr_log(DATA, folder / "c", lwr.HALF)),
        ("LWR 4+, another trajectory", lwr.lwr_log(DATA, folder / "d", lwr.OTHER)),
        ("AirBot Play, chirps", play(DATA, folder / "e", loaded=False)),
        ("AirBot Play, chirps with a load", play(DATA, folder / "f", loaded=True)),
        ("AirBot Play, five motions", _five_motions(folder / "g")),
        ("TX40", tx40.tx40_log(DATA, folder / "h", 4.0)),
        ("TIAGo", tiago.tiago_log(DATA, folder / "i")),
        ("EMPS", emps.emps_log(DATA, folder / "j", 2 / 3)),
    ]


def _five_motions(folder: Path) -> Log:
    learnt, judged = airbot_play_sessions.MOTIONS, airbot_play_sessions.FIRST[-1:]
    return airbot_play_sessions.airbot_log(DATA, folder, learnt, judged)


def by_hand(log: Log) -> np.ndarray:
    """Root mean square of what least squares leaves of the validation trials, by joint ``(n,)`` [N·m]."""
    model = nominal_robot(log).model
    joints = [model.joints[model.getJointId(name)].idx_v for name in log.header.torque_joints]
    learn = [_rows(model, log, trial, joints) for trial in log.role("identification")]
    judge = [_rows(model, log, trial, joints) for trial in log.role("validation")]
    columns, measured = (np.concatenate([part[k] for part in learn]) for k in (0, 1))
    std = np.ones(len(joints))
    for _ in range(3):
        a = (columns / std[None, :, None]).reshape(-1, columns.shape[2])
        answer = np.linalg.lstsq(a, (measured / std).ravel(), rcond=1e-8)[0]
        std = np.sqrt(np.mean((measured - columns @ answer) ** 2, axis=0))
    columns, measured = (np.concatenate([part[k] for part in judge]) for k in (0, 1))
    return np.sqrt(np.mean((measured - columns @ answer) ** 2, axis=0))


def _rows(model, log, trial, joints):
    """Columns ``(m, n, p)`` and torques ``(m, n)`` of a trial, filtered alike and thinned out."""
    rate = 1.0 / np.median(np.diff(trial.time))

    def low(x, hz):
        b, a = butter(4, min(0.9, hz / (0.5 * rate)))
        return filtfilt(b, a, x, axis=0)

    q = low(trial.q, 2 * _CUTOFF_HZ)
    v = np.gradient(q, 1.0 / rate, axis=0)
    acceleration = np.gradient(v, 1.0 / rate, axis=0)
    data = model.createData()
    body = np.array(
        [
            np.atleast_2d(pin.computeJointTorqueRegressor(model, data, *sample))[joints]
            for sample in zip(q, v, acceleration, strict=True)
        ]
    )
    own = [v[:, joints], np.tanh(v[:, joints] / _WIDTH), np.ones_like(v[:, joints])]
    if log.header.torque != "link_side":
        own.append(acceleration[:, joints])
    drives = [values[:, :, None] * np.eye(len(joints)) for values in own]
    order = [log.header.joints.index(name) for name in log.header.torque_joints]
    if trial.tau is not None:
        torque = trial.tau[:, order]
    else:
        torque = trial.current[:, order] * [log.header.torque_constants[log.header.joints[k]] for k in order]
    whole = low(np.concatenate([body, *drives, torque[:, :, None]], axis=2), _CUTOFF_HZ)
    step, edge = max(1, round(rate / _RATE_HZ)), int(rate / _CUTOFF_HZ)
    whole = whole[edge : len(whole) - edge : step]
    return whole[:, :, :-1], whole[:, :, -1]
