"""Times of samples as controllers count them."""

from __future__ import annotations

import numpy as np


def to_nanoseconds(time: np.ndarray) -> np.ndarray:
    """Times since the first sample as whole nanoseconds, ``(n,)`` integers, from ``(n,)`` seconds."""
    return np.asarray(np.round((np.asarray(time) - time[0]) * 1e9).astype(np.int64))
