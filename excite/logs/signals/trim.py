"""Cutting off standstill before and after a motion."""

from __future__ import annotations

import numpy as np

from excite.errors import LogError
from excite.robot.robot import Array


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
