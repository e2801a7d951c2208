"""Commands and positions of trials on even clocks, and which of their samples judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.logs.log import Log
from excite.rows.kinematics import forces_on_grid, positions_on_grid, trial_grid, trial_rate

# A piece of a trial: its name, its first and its last instant after the trial's start [s].
Span = tuple[str, float, float]


@dataclass(frozen=True, eq=False)
class EvenTrial:
    """A trial on an even clock.

    Attributes:
        name: stem of its file.
        learns: whether predictors are fitted on it.
        repeats: name of the trial that it says it repeats.
        time: ``(n,)`` from its start [s].
        position: ``(n, n_joints)`` [rad or m].
        command: as ``position``.
        judges: ``(n,)`` which samples judge.
    """

    name: str
    learns: bool
    repeats: str | None
    time: Array
    position: Array
    command: Array
    judges: NDArray[np.bool_]

    @property
    def q(self) -> Array:
        """What trials are compared by: the command, ``(n, n_joints)``."""
        return self.command

    @cached_property
    def v(self) -> Array:
        """Its velocity, ``(n, n_joints)``."""
        return np.gradient(self.command, self.time, axis=0)


def even_trials(log: Log, joints: Sequence[str], spans: Sequence[Span] = ()) -> tuple[EvenTrial, ...]:
    """Trials of a log that have commands.

    Args:
        log: the log, repaired.
        joints: in the order that is wanted.
        spans: pieces that judge; by default the whole validation trials, all trials where there are none.
    """
    order = [log.header.joints.index(name) for name in joints]
    rate = common_rate(log)
    spared = bool(log.role("validation"))
    made = []
    for trial in log.trials:
        if trial.q_cmd is None:
            continue
        grid = trial_grid(trial, rate)
        position = positions_on_grid(trial.time, trial.q, grid)[:, order]
        # Commands come in steps, which a spline would overshoot.
        command = forces_on_grid(trial.time, trial.q_cmd, grid)[:, order]
        time, learns = grid - grid[0], trial.role == "identification"
        judges = np.full(len(time), not spans and not (spared and learns))
        for name, first, last in spans:
            if name == trial.name:
                judges |= (time >= first - 1e-9) & (time <= last + 1e-9)
        made.append(EvenTrial(trial.name, learns, trial.repeats, time, position, command, judges))
    return tuple(made)


def common_rate(log: Log) -> float:
    """The rate that all trials are brought to [Hz]."""
    return float(np.median([trial_rate(log.header, trial) for trial in log.trials]))
