"""When a joint stands: before and after a motion, and within one as far as its encoder tells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from excite.robot.robot import Array

if TYPE_CHECKING:
    from excite.diagnosis.samples import ArmSamples

# Speed below which a joint stands before and after a motion, and by which it surely moves within one [rad/s].
_STILL, _STANDS = 0.01, 0.012
# Share of standstill from which a row is a standing joint's.
_HELD = 0.3


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


def standing_share(samples: ArmSamples) -> Array:
    """Share of standstill that the filter mixes into each row, ``(n_joints, n_rows)``, 0…1."""
    v = samples.stacked("v")[:, list(samples.index)]
    return samples.rows(samples.standstill**2 / (v**2 + samples.standstill**2)).T


def held_power(samples: ArmSamples, residual: Array, floor: Array, rows: NDArray[np.bool_]) -> Array:
    """Power that standing joints leave above the noise, as a mean over all rows, ``(n_joints,)`` [(N·m)²].

    Dry friction holds a joint that stands with whatever torque it takes, which no model of the motion tells: it is
    as much a floor as noise is.

    Args:
        samples: the samples.
        residual: ``(n_joints, n_rows)`` what a model leaves [N·m].
        floor: ``(n_joints,)`` noise [N·m].
        rows: ``(n_rows,)`` which rows to tell it of.
    """
    held = (standing_share(samples) > _HELD) & rows
    share = held.sum(axis=1) / max(int(rows.sum()), 1)
    power = (np.square(residual) * held).sum(axis=1) / np.maximum(held.sum(axis=1), 1)
    return np.asarray(share * np.maximum(power - floor**2, 0.0))


def moving_span(v: Array, least: int) -> tuple[int, int]:
    """First and last sample at which a joint moves; all where that is too short a stretch.

    Args:
        v: ``(n, n_joints)`` [rad/s].
        least: samples of a stretch that is long enough.
    """
    moving = np.flatnonzero((np.abs(v) > _STILL).any(axis=1))
    if len(moving) == 0 or moving[-1] - moving[0] < least:
        return 0, len(v) - 1
    return int(moving[0]), int(moving[-1])
