"""Joints that stand within a motion: how much of it, and the torque that friction takes up there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.samples import ArmSamples

# Share of standstill from which a row is a standing joint's.
HELD = 0.3
# Fewer rows of motion tell nothing of a joint. A simulated wrist that sticks leaves 15 times its noise where 3 of 4300
# rows are of motion, twice where 88 are, nothing where 456 are.
_LEAST_ROWS = 20


def standing_share(samples: ArmSamples) -> Array:
    """Share of standstill that the filter mixes into each row, ``(n_joints, n_rows)``, 0…1."""
    v = samples.motor_signal("v")
    return samples.to_rows(samples.standstill**2 / (v**2 + samples.standstill**2)).T


def held_power(samples: ArmSamples, residual: Array, floor: Array, rows: NDArray[np.bool_]) -> Array:
    """Power that standing joints leave above the noise and above what moving ones leave, as a mean over all rows.

    Dry friction holds a joint that stands with whatever torque it takes, which no model of the motion tells: it is
    as much a floor as noise is. What moving joints leave alike is the model's, which is told by the record without
    asking what explains it.

    Args:
        residual: ``(n_joints, n_rows)`` what the model leaves before any effect [N·m].
        floor: ``(n_joints,)`` noise [N·m].
        rows: ``(n_rows,)`` which rows to tell it of.

    Returns:
        ``(n_joints,)`` [(N·m)²].
    """
    held = (standing_share(samples) > HELD) & rows
    share = held.sum(axis=1) / max(int(rows.sum()), 1)
    standing, moving = (
        (np.square(residual) * use).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
        for use in (held, rows & ~held)
    )
    return np.asarray(share * np.maximum(standing - np.maximum(floor**2, moving), 0.0))


def stands_throughout(samples: ArmSamples) -> NDArray[np.bool_]:
    """Joints that hardly ever move: a gripper that is held, an axis that only trembles, ``(n_joints,)``.

    What is called motion in the few rows above standstill is a joint that gives before its friction is overcome.
    """
    moving = np.count_nonzero(standing_share(samples) <= HELD, axis=1)
    return np.asarray(moving < _LEAST_ROWS)


def with_held(samples: ArmSamples, residual: Array, floor: Array) -> Array:
    """The floor of each joint, ``(n_joints,)``; of one that stands throughout all that a model leaves of it.

    Rows of such a joint weigh as much as those of others: its torque tells of bodies as soon as these explain it. What
    they do not explain is its friction's, whatever that is.

    Args:
        residual: ``(n_joints, n_rows)`` what a model with all effects leaves, weighted [N·m].
        floor: ``(n_joints,)`` noise [N·m].
    """
    fitted = samples.identification_rows
    parts = [np.square(residual[:, rows]).mean(axis=1) for rows in (fitted, ~fitted) if rows.any()]
    left = np.sqrt(np.max(parts, axis=0))
    return np.asarray(np.where(stands_throughout(samples), np.maximum(floor, left), floor))
