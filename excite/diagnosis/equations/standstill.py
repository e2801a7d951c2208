"""When a joint stands: before and after a motion, and within one as far as its encoder tells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array

# Speed below which a joint stands before and after a motion, and by which it surely moves within one [rad/s].
_STILL, _STANDS = 0.01, 0.012


def standstill_speed(positions: Sequence[Array], band_hz: float) -> float:
    """Speed up to which a joint may as well stand [rad/s]: no slower than its encoder tells within the band.

    Args:
        positions: of the joint as logged, one ``(n,)`` a trial [rad].
        band_hz: end of the band of the kinematics [Hz].
    """
    values = np.concatenate(positions)
    levels = np.unique(np.round(values, 9))
    coarse = 2 < len(levels) < len(values) / 3
    return max(_STANDS, 2.0 * band_hz * float(np.median(np.diff(levels)))) if coarse else _STANDS


def span_of_motion(v: Array, least: int) -> tuple[int, int]:
    """First and last sample at which a joint moves; all where that is too short a stretch.

    Args:
        v: ``(n, n_joints)`` [rad/s].
        least: samples of a stretch that is long enough.
    """
    moving = np.flatnonzero((np.abs(v) > _STILL).any(axis=1))
    if len(moving) == 0 or moving[-1] - moving[0] < least:
        return 0, len(v) - 1
    return int(moving[0]), int(moving[-1])
