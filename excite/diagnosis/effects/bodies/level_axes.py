"""The directions in which a tilt of the base turns gravity."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

# Cosine beyond which the base's x axis is upright rather than level.
_UPRIGHT = 0.9


def level_axes(gravity: Array) -> Array:
    """Unit vectors in the base frame, ``(3, 3)``: two level ones, along x and y on a level base, and down.

    Args:
        gravity: ``(3,)`` nominal gravity in the base frame [m/s²]; straight down in its z where it is nothing.

    Returns:
        In rows; where the base's x axis is upright, the first is along its y axis.
    """
    size = float(np.linalg.norm(gravity))
    down = np.asarray(gravity, dtype=np.float64) / size if size > 0.0 else np.array([0.0, 0.0, -1.0])
    along = np.eye(3)[1 if abs(down[0]) > _UPRIGHT else 0]
    first = along - (along @ down) * down
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(first, down), down])
