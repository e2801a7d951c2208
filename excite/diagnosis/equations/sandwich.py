"""Standard deviations by which trials disagree: the sandwich of their gradients (Liang, Zeger 1986)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array


def std_of_trials(
    rows: Sequence[Array], rest: Sequence[Array], trial: NDArray[np.int64], prior: Array
) -> Array:
    """Standard deviations of the coefficients of a weighted least-squares fit, ``(n,)``, in its rows' units.

    Args:
        rows: by channel, ``(n_rows, n)`` in units of its noise.
        rest: by channel, ``(n_rows,)`` what the fit leaves, in the same units.
        trial: ``(n_rows,)`` index of the trial.
        prior: ``(n,)`` precision that each coefficient has a priori.
    """
    trials = np.unique(trial)
    normal, gradients = np.diag(prior), np.zeros((len(trials), len(prior)))
    for a, left in zip(rows, rest, strict=True):
        normal += a.T @ a
        gradients += [left[trial == k] @ a[trial == k] for k in trials]
    # Columns that a short record cannot tell apart, or does not show, have no deviation of their own.
    moved = np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ gradients.T
    return np.sqrt((moved**2).sum(axis=1) * len(trials) / (len(trials) - 1))
