"""Fewer samples, after a filter that leaves nothing that they could alias."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def decimation_step(rate_hz: float, target_hz: float) -> int:
    """Every how manieth sample is kept so that at least ``target_hz`` [Hz] remain."""
    return max(1, int(rate_hz / target_hz + 1e-9))


def kept_samples(n: int, step: int) -> NDArray[np.int64]:
    """Indices of the samples that stay, the first half a step from the start."""
    return np.arange(step // 2, n, step)
