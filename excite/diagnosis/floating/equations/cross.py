"""Cross products of many vectors."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array


def cross(vector: Array, other: Array) -> Array:
    """``vector (n, 3) × other``, the latter ``(n, 3)``, or ``(n, 3, k)`` for columns.

    For the thousands of small arrays of a search, where numpy's own spends its time on moving axes.
    """
    x, y, z = vector.T if other.ndim == 2 else vector.T[:, :, None]
    a, b, c = other[:, 0], other[:, 1], other[:, 2]
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)
