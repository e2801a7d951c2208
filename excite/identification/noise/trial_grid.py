"""Rows of an identification problem back in the order of time: trials on uniform grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem


@dataclass(frozen=True, eq=False)
class TrialGrid:
    """Rows of one trial laid out on a uniform time grid.

    Attributes:
        rows: ``(n_rows_of_trial,)`` indices into the problem's rows.
        sample: ``(n_rows_of_trial,)`` index of each row's instant on the grid.
        n_samples: length of the grid; instants without a row are gaps.
        step_s: its step [s].
    """

    rows: NDArray[np.int64]
    sample: NDArray[np.int64]
    n_samples: int
    step_s: float = 1.0

    def spread(self, values: Array, channel: NDArray[np.int64], n_channels: int) -> Array:
        """Values of the trial's rows as ``(n_samples, n_channels, …)``, zero in gaps."""
        grid = np.zeros((self.n_samples, n_channels, *values.shape[1:]))
        grid[self.sample, channel[self.rows]] = values
        return grid


def trial_grids(problem: IdentificationProblem) -> tuple[TrialGrid, ...]:
    """Lay the rows of every trial on a uniform grid whose step is the median step of its times."""
    grids = []
    for trial in range(len(problem.trial_names)):
        rows = np.flatnonzero(problem.trial == trial)
        if not len(rows):
            continue
        time = problem.time[rows]
        steps = np.diff(np.unique(time))
        step = float(np.median(steps)) if len(steps) else 1.0
        sample = np.round((time - time.min()) / step).astype(np.int64)
        grids.append(TrialGrid(rows, sample, int(sample.max()) + 1, step))
    return tuple(grids)
