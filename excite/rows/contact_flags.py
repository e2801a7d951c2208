"""Contact flags of a trial on the grid of its kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, widen_flags
from excite.errors import LogError
from excite.logs.log import Trial
from excite.robot.robot import Robot
from excite.rows.filtered_rows import TrialRows
from excite.rows.kinematics import TrialKinematics

CHANGE_S = 0.01
"""Rows this long before and after a change of contacts are left out: a strike is over, and flags are right [s]."""


def closed_on_grid(robot: Robot, trial: Trial, grid: Array) -> NDArray[np.bool_]:
    """Which feet carry, ``(n, n_feet)``: each flag as at the last sample before.

    Args:
        robot: the robot in the log; one without feet, which hangs, has no flags.
        trial: the trial.
        grid: ``(n,)`` [s].

    Raises:
        LogError: a foot has no flag.
    """
    for foot in robot.feet:
        if foot.name not in trial.contacts:
            raise LogError(
                "is missing",
                source=trial.name,
                field=f"contact.{foot.name}",
                remedy="log whether the foot carries (1) or not (0), or add sensors of its contact wrench",
            )
    last = np.clip(np.searchsorted(trial.time, grid + 1e-9, side="right") - 1, 0, len(trial.time) - 1)
    flags = [np.asarray(trial.contacts[foot.name], dtype=bool)[last] for foot in robot.feet]
    return np.column_stack(flags) if flags else np.zeros((len(grid), 0), dtype=bool)


def away_from_changes(rows: TrialRows, k: TrialKinematics, closed: NDArray[np.bool_] | None) -> TrialRows:
    """Rows less those about a change of contacts, where feet strike and flags come late.

    Args:
        rows: of one trial.
        k: the trial's kinematics.
        closed: which feet carry, ``(n, n_feet)``; None where contacts play no part.
    """
    if closed is None or not closed.shape[1]:
        return rows
    near = _near_change(closed, round(CHANGE_S * k.rate_hz))[np.searchsorted(k.time, rows.time)]
    return replace(rows, use=rows.use & ~near[:, None])


def _near_change(closed: NDArray[np.bool_], samples: int) -> NDArray[np.bool_]:
    """Samples within ``samples`` of a change of any flag, ``(n,)``."""
    change = np.zeros(len(closed), dtype=bool)
    differ = (closed[1:] != closed[:-1]).any(axis=1)
    change[1:] |= differ
    change[:-1] |= differ
    return widen_flags(change, samples)
