"""What one expects of inertial parameters before looking at data."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

_SHARE, _ARM_M = 0.3, 0.04


def inertial_scales(phi: Array) -> Array:
    """Standard deviation of the error of each nominal parameter, ``(10·n,)`` as ``phi``.

    Three tenths of a mass and of moments of inertia, and a few centimetres of the centre of mass: loose, so
    that data decide wherever they say anything, and blind directions stay nominal.
    """
    scales = np.empty_like(phi)
    table, out = phi.reshape(-1, 10), scales.reshape(-1, 10)
    mass = table[:, 0]
    inertia = np.abs(table[:, [4, 6, 9]]).sum(axis=1)
    out[:, 0] = _SHARE * mass
    out[:, 1:4] = (_ARM_M * mass + _SHARE * np.abs(table[:, 1:4]).max(axis=1))[:, None]
    out[:, 4:] = (_SHARE * inertia + _ARM_M**2 * mass)[:, None]
    return scales
