"""How much of a log's torques lies within the ranges of what measured them, and which rows do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.logs.log import Log, Trial
from excite.rows.beyond import flags_at, reached_samples
from excite.rows.kinematics import TrialKinematics

# Share of a log's rows in which all torques are within their ranges, from which the others need not be looked at.
_ENOUGH = 0.25


def rows_within(log: Log) -> Array:
    """Share of the rows that are looked at in which each torque is not clipped, ``(n_torques,)``, above zero."""
    trials = log.role("identification")
    if _enough(log):
        return np.ones(len(log.header.torque_joints))
    rows = max(1, sum(len(trial.time) for trial in trials))
    kind = "i" if log.header.torque == "current" else "tau"
    cut = [
        sum(trial.cleaning.clipped.get(f"{kind}.{joint}", 0) for trial in trials)
        for joint in log.header.torque_joints
    ]
    return 1.0 - np.minimum(np.array(cut, dtype=float), rows - 1) / rows


def looked_at(log: Log, trial: Trial, k: TrialKinematics, cutoff_hz: float) -> NDArray[np.bool_]:
    """Rows of a trial in which all torques are within their ranges, ``(n,)``; all where too few of the log are.

    Args:
        log: the log.
        trial: one of its trials.
        k: its kinematics, whose samples the rows are.
        cutoff_hz: of the filter that torques go through [Hz].
    """
    if trial.beyond is None or not _enough(log):
        return np.ones(len(k.time), dtype=np.bool_)
    lost = np.asarray(flags_at(trial.time, trial.beyond, k.time).any(axis=1))
    return ~reached_samples(lost, k.rate_hz, cutoff_hz)


def _enough(log: Log) -> bool:
    """Whether some torques of a log are beyond their range, and in enough of its rows none is."""
    trials = log.role("identification")
    if all(trial.beyond is None for trial in trials):
        return False
    lost = sum(0 if trial.beyond is None else int(trial.beyond.any(axis=1).sum()) for trial in trials)
    rows = sum(len(trial.time) for trial in trials)
    return rows - lost >= _ENOUGH * rows
