"""How much of a log's torques lies within the ranges of what measured them, and which rows do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from excite.arrays import Array
from excite.logs.log import Log, Trial
from excite.rows.beyond import flags_at

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


def looked_at(log: Log, trial: Trial, grid: Array, reach: int) -> NDArray[np.bool_]:
    """Rows of a trial in which all torques are within their ranges, ``(n,)``; all where too few of the log are.

    Args:
        log: the log.
        trial: one of its trials.
        grid: ``(n,)`` times of the rows [s].
        reach: rows that a filter's response has on either side.
    """
    if trial.beyond is None or not _enough(log):
        return np.ones(len(grid), dtype=np.bool_)
    lost = flags_at(trial.time, trial.beyond, grid).any(axis=1)
    return ~binary_dilation(lost, np.ones(2 * reach + 1, dtype=np.bool_))


def _enough(log: Log) -> bool:
    """Whether some torques of a log are beyond their range, and in enough of its rows none is."""
    trials = log.role("identification")
    if all(trial.beyond is None for trial in trials):
        return False
    lost = sum(0 if trial.beyond is None else int(trial.beyond.any(axis=1).sum()) for trial in trials)
    rows = sum(len(trial.time) for trial in trials)
    return rows - lost >= _ENOUGH * rows
