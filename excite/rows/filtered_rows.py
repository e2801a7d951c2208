"""Rows of a regression at full rate, filtered and decimated block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from excite.arrays import Array
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.decimate import decimation_step, kept_samples
from excite.rows.kinematics import TrialKinematics
from excite.rows.settings import Filters

_BLOCK_BYTES = 64e6


@dataclass(frozen=True, eq=False)
class TrialRows:
    """Rows of one trial, decimated.

    Attributes:
        values: ``(m, n_channels, n_params + 1)``: regressor, then measurement.
        time: ``(m,)`` [s].
        use: ``(m, n_channels)`` rows worth keeping.
        freedom: ``(m, n_channels)`` share of each row's noise that is its own, below one where what was taken out
            of the rows ties them; None where nothing was.
    """

    values: Array
    time: Array
    use: NDArray[np.bool_]
    freedom: Array | None = None


RowSource = Callable[[slice], Array]
"""Rows ``(m, n_channels, n_params + 1)`` of a slice of samples, at full rate."""


def filtered_rows(
    source: RowSource, kinematics: TrialKinematics, filters: Filters, use: NDArray[np.bool_]
) -> TrialRows:
    """Filter regressor columns and measurement alike, then keep every k-th sample.

    As the filter is linear, ``F(Y) θ = F(τ)`` holds exactly where ``Y θ = τ`` does; filtering before the
    regressor is computed would not keep it (Gautier 1997, parallel decimation).

    Args:
        source: rows at full rate by slice of samples.
        kinematics: the trial's kinematics.
        filters: cut-off, order and rate.
        use: ``(n, n_channels)`` samples whose rows may be used.

    Returns:
        The rows that stay, in order of time.
    """
    rate, cutoff, n = kinematics.rate_hz, filters.cutoff_hz, len(kinematics.time)
    settling = settling_samples(rate, cutoff)
    step = decimation_factor(rate, filters)
    kept = kept_samples(n, step)
    use = _erode_rows(use, kinematics.valid, settling)
    probe = source(slice(0, 1))
    block = max(4 * settling, int(_BLOCK_BYTES / (8 * probe[0].size)), 1)
    parts = []
    for start in range(0, n, block):
        inside = kept[(kept >= start) & (kept < start + block)]
        if not use[inside].any():
            parts.append(np.zeros((len(inside), *probe.shape[1:])))
            continue
        # Neighbouring blocks overlap by twice the filter's transient, and a short rest joins the last one.
        low, high = max(0, start - 2 * settling), min(n, start + block + 2 * settling)
        low = min(low, max(0, high - 4 * settling - 1))
        parts.append(lowpass(source(slice(low, high)), rate, cutoff, filters.order)[inside - low])
    return TrialRows(np.concatenate(parts), kinematics.time[kept], use[kept])


def decimation_factor(rate_hz: float, filters: Filters) -> int:
    """Every how manieth sample is kept."""
    return decimation_step(rate_hz, filters.rate_hz)


def _erode_rows(use: NDArray[np.bool_], valid: NDArray[np.bool_], settling: int) -> NDArray[np.bool_]:
    """Take away what the filter's transient reaches: all of it at the ends, half of it at gaps."""
    half = settling // 2
    if half:
        use = scipy.ndimage.binary_erosion(use, np.ones((2 * half + 1, 1), dtype=bool), border_value=0)
    ends = np.flatnonzero(valid)
    if len(ends):
        use[: ends[0] + settling] = use[ends[-1] + 1 - settling :] = False
    return use
