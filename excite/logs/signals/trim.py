"""Cutting off standstill before and after a motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError


def moving_span(velocity: Array, threshold: float) -> slice:
    """Samples from the first to the last at which any joint moves.

    Args:
        velocity: ``(n, n_joints)`` [rad/s or m/s].
        threshold: speed above which a joint counts as moving, same unit.

    Returns:
        The slice.

    Raises:
        LogError: no joint ever moves.
    """
    moving = np.flatnonzero((np.abs(velocity) > threshold).any(axis=1))
    if len(moving) == 0:
        raise LogError(
            f"no joint is ever faster than {threshold:g} rad/s",
            field="q",
            remedy="record a motion, or lower the standstill velocity",
        )
    return slice(int(moving[0]), int(moving[-1]) + 1)


def long_standstill(velocity: Array, threshold: float, shortest: int) -> NDArray[np.bool_]:
    """Samples in stretches of at least ``shortest`` samples in which a joint stands, ``(n, n_joints)``.

    There its friction is anything up to the breakaway torque and says nothing; a mere change of direction is
    shorter.

    Args:
        velocity: ``(n, n_joints)`` [rad/s or m/s].
        threshold: speed below which a joint counts as standing, same unit.
        shortest: shortest stretch [samples].
    """
    from scipy.ndimage import binary_opening

    slow = np.abs(velocity) < threshold
    return np.asarray(binary_opening(slow, np.ones((shortest, 1), dtype=bool)))
