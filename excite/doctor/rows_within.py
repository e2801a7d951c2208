"""How much of a log's torques lies within the ranges of what measured them."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.logs.log import Log


def rows_within(log: Log) -> Array:
    """Share of the rows of identification in which each torque is not clipped, ``(n_torques,)``, above zero."""
    trials = log.role("identification")
    rows = max(1, sum(len(trial.time) for trial in trials))
    kind = "i" if log.header.torque == "current" else "tau"
    cut = [
        sum(trial.cleaning.clipped.get(f"{kind}.{joint}", 0) for trial in trials)
        for joint in log.header.torque_joints
    ]
    return 1.0 - np.minimum(np.array(cut, dtype=float), rows - 1) / rows
