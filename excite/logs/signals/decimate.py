"""Fewer samples, after a filter that leaves nothing that they could alias."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.logs.signals.butterworth import lowpass


def decimation_step(rate_hz: float, target_hz: float) -> int:
    """Every how manieth sample is kept so that at least ``target_hz`` [Hz] remain."""
    return max(1, int(rate_hz / target_hz + 1e-9))


def kept_samples(n: int, step: int) -> NDArray[np.int64]:
    """Indices of the samples that stay, the first half a step from the start."""
    return np.arange(step // 2, n, step)


def decimate(values: Array, rate_hz: float, target_hz: float, order: int = 4) -> Array:
    """Filter below a quarter of the new rate without phase, and keep every k-th sample.

    Args:
        values: ``(n, …)`` uniformly sampled.
        rate_hz: its rate [Hz].
        target_hz: rate wanted; the next higher whole fraction of ``rate_hz`` is given.
        order: order of the single pass of the filter.

    Returns:
        ``(m, …)``.

    Raises:
        LogError: the signal is shorter than the filter needs.
    """
    step = decimation_step(rate_hz, target_hz)
    if step == 1:
        return values.copy()
    return lowpass(values, rate_hz, 0.25 * rate_hz / step, order)[kept_samples(len(values), step)]
