"""Single samples that are far from their neighbours: found and replaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from excite.arrays import Array

# From the median absolute deviation to the standard deviation of a normal distribution.
_NORMAL = 1.4826


@dataclass(frozen=True, eq=False)
class Outliers:
    """A signal without its outliers.

    Attributes:
        values: ``(n, …)`` outliers replaced by the median of their neighbourhood.
        found: ``(n, …)`` True where one was.
    """

    values: Array
    found: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Number of samples replaced, all channels together."""
        return int(self.found.sum())


def replace_outliers(values: Array, sigma: float = 6.0, half_window: int = 3) -> Outliers:
    """Replace samples that lie further than ``sigma`` deviations from the median of their neighbourhood.

    The Hampel identifier (Pearson 2002, Outliers in process modeling and identification, IEEE Trans. Control
    Systems Technology 10(1), section IV): the deviation is the larger of the neighbourhood's own (from its
    median absolute deviation) and the whole signal's about its running median, so that a signal at rest or
    in coarse steps is left alone.

    Args:
        values: ``(n, …)`` along time.
        sigma: how many standard deviations.
        half_window: neighbours on either side.

    Returns:
        The repaired signal; ``half_window`` samples in a row that are off together are not recognised.
    """
    values = np.asarray(values, dtype=float)
    flat = values.reshape(len(values), -1)
    repaired, found = flat.copy(), np.zeros(flat.shape, dtype=bool)
    for channel in range(flat.shape[1]):
        padded = np.pad(flat[:, channel], half_window, mode="edge")
        windows = sliding_window_view(padded, 2 * half_window + 1)
        median = np.median(windows, axis=1)
        local = _NORMAL * np.median(np.abs(windows - median[:, None]), axis=1)
        apart = np.abs(flat[:, channel] - median)
        # What is not zero: a monotone stretch is its own running median.
        off = apart[apart > 0.0]
        overall = _NORMAL * float(np.median(off)) if len(off) else 0.0
        found[:, channel] = apart > sigma * np.maximum(local, overall)
        repaired[found[:, channel], channel] = median[found[:, channel]]
    return Outliers(repaired.reshape(values.shape), found.reshape(values.shape))
