"""What the nominal model and a model of the drive explain of torques."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from excite.arrays import Array, Flags
from excite.doctor.thresholds import THRESHOLD
from excite.rows.drive_terms import smooth_sign

# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02

ALL_FREE = np.ones(3, dtype=np.bool_)
"""All columns of the drive."""


def drive_columns(v: Array, a: Array, speed: float | Array = 1.0) -> Array:
    """What drives of measured joints feel: velocities, their smooth signs, accelerations, ``(3, n, n_torques)``.

    They are read as ``speed`` times what was logged. Dry friction changes its sign over the same rows whatever the
    clock and the unit: its shape is not known well enough to tell how fast a joint is.
    """
    return np.stack([v, smooth_sign(v, WIDTH * speed), a])


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of torques about their means, with the sums of their products: what any least squares asks for.

    Readings that scale torques, turn or shift them, and models that are mixtures of parts, are answered from the sums
    without another pass over the samples. The first three columns are those of the drive.

    Attributes:
        values: ``(…, m, k, n)`` of each of m torques; nought where a column is constant but for rounding.
        sums: ``(…, m, k, k)``.
    """

    values: Array
    sums: Array

    @classmethod
    def of(cls, drive: Array, *parts: Array) -> Columns:
        """Those of the drive ``(3, n, m)``, and parts ``(n, m)``, or of several models ``(s, n, m)``."""
        columns = np.broadcast_arrays(*drive, *parts)
        values = _subtract_mean(np.stack([one.swapaxes(-1, -2) for one in columns], axis=-2))
        return cls(values, values @ values.swapaxes(-1, -2))

    def sums_with(self, torque: Array) -> Array:
        """The sums with those of torques ``(…, n, m)`` as the last column, ``(…, m, k + 1, k + 1)``."""
        target = _subtract_mean(torque.swapaxes(-1, -2))[..., None]
        both = self.values @ target
        *shape, k, _ = both.shape
        found = np.empty((*shape, k + 1, k + 1))
        found[..., :k, :k], found[..., :k, k:], found[..., k:, :k] = self.sums, both, both.swapaxes(-1, -2)
        found[..., k, k] = np.einsum("...ni,...ni", target, target)
        return found


def _subtract_mean(values: Array) -> Array:
    """Values ``(…, n)`` less their means; nought where only filters' rounding is left."""
    mean = values.mean(axis=-1)
    centred = values - mean[..., None]
    power = np.einsum("...n,...n", centred, centred)
    centred[power <= THRESHOLD.dead_share * (power + values.shape[-1] * mean**2)] = 0.0
    return np.asarray(centred)


class Predicted(NamedTuple):
    """What a model says of measured joints.

    Attributes:
        torque: of rigid bodies ``(n, n_torques)`` [N·m].
        drive: of :func:`drive_columns`.
        columns: of the drive and the bodies.
    """

    torque: Array
    drive: Array
    columns: Columns


def remove_drives(sums: Array, free: Flags = ALL_FREE) -> tuple[Array, Array]:
    """Sums of columns beside those of the drive, and what of these is in each, by least squares.

    Args:
        sums: ``(…, k, k)``, those of the drive first.
        free: ``(…, 3)`` which of the drive's columns there are.

    Returns:
        ``(…, k - 3, k - 3)``, and ``(…, 3, k - 3)``.
    """
    size = np.sqrt(np.maximum(np.einsum("...ii->...i", sums)[..., :3], 1e-300))
    gram = sums[..., :3, :3] / size[..., None] / size[..., None, :]
    one = np.eye(3)
    kept = np.where(free[..., None] & free[..., None, :], gram + THRESHOLD.trace * one, one)
    both = np.where(free[..., None], sums[..., :3, 3:] / size[..., None], 0.0)
    found = np.linalg.solve(kept, both)
    return sums[..., 3:, 3:] - both.swapaxes(-1, -2) @ found, found / size[..., None]


def shares_left(sums: Array) -> Array:
    """Share of torques' power that the model and the joint's own drive leave.

    The model's gain is free within bounds, an offset is free; friction takes power out and rotors are heavy: these
    coefficients are not negative. So a torque with its sign turned is explained by nothing. Of least squares with each
    set of the drive's columns, the gain at a bound where it would be beyond, the best that holds is taken: no tolerance
    has to be chosen.

    Args:
        sums: ``(…, 5, 5)`` of velocity, its sign, acceleration, model and torque, as of :meth:`Columns.sums_with`.

    Returns:
        ``(…)``; one for a torque that never changes.
    """
    sets = np.array(list(product((True, False), repeat=3)))
    rest, found = remove_drives(sums, sets.reshape(8, *(1,) * (sums.ndim - 2), 3))
    changes = sums[..., 4, 4] > 0.0
    model, both, torque = rest[..., 0, 0], rest[..., 0, 1], rest[..., 1, 1]
    gain = both / np.maximum(model, 1e-300)
    gain = np.clip(gain, THRESHOLD.least_model_gain, THRESHOLD.most_model_gain)
    holds = (found[..., 1] - gain[..., None] * found[..., 0] >= 0.0).all(axis=-1)
    left = np.where(holds, torque - 2.0 * gain * both + gain**2 * model, np.inf).min(axis=0)
    return np.asarray(np.where(changes, np.maximum(left, 0.0) / np.where(changes, sums[..., 4, 4], 1.0), 1.0))


class PartsFit(NamedTuple):
    """Parts of torques by least squares beside what drives make, of whatever sign.

    Attributes:
        parts: ``(m, k)`` weights of the parts; ``drive``: ``(m, 3)`` of the drive's columns.
        bare: ``(m, k + 1)`` power of the parts and of the torque without what the drive explains of it.
        left: ``(m,)`` power that nothing explains; ``friction``: that of viscous and dry friction.
    """

    parts: Array
    drive: Array
    bare: Array
    left: Array
    friction: Array


def fit_parts(sums: Array) -> PartsFit:
    """Weights of k parts of torques beside the drive, by sums ``(m, k + 4, k + 4)`` of :meth:`Columns.sums_with`."""
    rest, drives = remove_drives(sums)
    both = rest[:, :-1, -1:]
    parts = np.linalg.pinv(rest[:, :-1, :-1], rcond=THRESHOLD.dead_share, hermitian=True) @ both
    drive = (drives[:, :, -1:] - drives[:, :, :-1] @ parts)[..., 0]
    friction = np.einsum("jk,jkl,jl->j", drive[:, :2], sums[:, :2, :2], drive[:, :2])
    left = np.maximum(rest[:, -1, -1] - (parts * both).sum(axis=(1, 2)), 0.0)
    return PartsFit(parts[..., 0], drive, np.einsum("jkk->jk", rest), left, friction)
