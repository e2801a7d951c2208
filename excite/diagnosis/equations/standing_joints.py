"""Joints that stand within a motion: how much of it, and the torque that friction takes up there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.samples import ArmSamples

# Share of standstill from which a row is a standing joint's.
HELD = 0.3


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
    held = (standing_share(samples) > HELD) & rows
    share = held.sum(axis=1) / max(int(rows.sum()), 1)
    power = (np.square(residual) * held).sum(axis=1) / np.maximum(held.sum(axis=1), 1)
    return np.asarray(share * np.maximum(power - floor**2, 0.0))
