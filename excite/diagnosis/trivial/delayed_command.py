"""The simplest servo there is: each joint is where its command was some time ago, to a scale and an offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.trivial.even_trial import EvenTrial

# What follows its command later than this is no servo [s]; so fine is the first search [s], and so many times finer the
# second.
_LATEST_S, _STEP_S, _FINER = 0.5, 0.005, 10
# Rows enough to fit three numbers a joint on.
_ROWS = 20_000


@dataclass(frozen=True, eq=False)
class DelayedCommand:
    """``q_j(t) = scale_j q_cmd_j(t − delay_j) + offset_j``.

    Attributes:
        delay_s: ``(n_joints,)`` [s].
        scale: ``(n_joints,)``.
        offset: ``(n_joints,)`` [rad or m].
    """

    delay_s: Array
    scale: Array
    offset: Array

    def predicted(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""
        columns = zip(trial.command.T, self.delay_s, strict=True)
        late = [np.interp(trial.time - delay, trial.time, column) for column, delay in columns]
        return np.column_stack(late) * self.scale + self.offset


def fit_delayed_command(trials: Sequence[EvenTrial]) -> DelayedCommand:
    """The delay, scale and offset of each joint with the least squared error on these trials."""
    rows = sum(len(t.time) for t in trials)
    thin = max(1, rows // _ROWS)
    shortest = min(float(t.time[-1]) for t in trials)
    period = float(np.median(np.diff(trials[0].time)))
    step = max(period, _STEP_S)
    found = []
    for j in range(trials[0].command.shape[1]):
        coarse = np.arange(0.0, min(_LATEST_S, 0.25 * shortest) + 0.5 * step, step)
        best = min((_fitted(trials, j, float(delay), thin) for delay in coarse), key=lambda x: x.error)
        fine = best.delay + step / _FINER * np.arange(1 - _FINER, _FINER)
        tried = (_fitted(trials, j, float(delay), thin) for delay in fine if delay >= 0.0)
        found.append(min(tried, key=lambda x: x.error))
    _, delay, scale, offset = np.array(found).T
    return DelayedCommand(delay, scale, offset)


class _Fitted(NamedTuple):
    """Mean squared error, delay, scale and offset of a joint."""

    error: float
    delay: float
    scale: float
    offset: float


def _fitted(trials: Sequence[EvenTrial], joint: int, delay: float, thin: int) -> _Fitted:
    """The fit of a joint at a delay."""
    late = np.concatenate([np.interp(t.time[::thin] - delay, t.time, t.command[:, joint]) for t in trials])
    here = np.concatenate([t.position[::thin, joint] for t in trials])
    x, y = late - late.mean(), here - here.mean()
    power = float(x @ x)
    scale = float(x @ y) / power if power > 0.0 else 0.0
    left = float(((y - scale * x) ** 2).mean())
    return _Fitted(left, float(delay), scale, float(here.mean() - scale * late.mean()))
