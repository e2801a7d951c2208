"""One joint's torque beside the nominal model's: what model and drive explain of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from excite.arrays import Array
from excite.rows.drive_terms import smooth_sign

# Nominal masses are believed within these factors.
_GAIN = (0.5, 2.0)
# A torque whose power is all but this share in its mean is a dead channel.
_DEAD = 1e-12
_TRACE = 1e-9 * np.eye(4)
# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02


class Predicted(NamedTuple):
    """What a model says of measured joints.

    Attributes:
        torque: of rigid bodies ``(n, n_torques)`` [N·m].
        v: velocities ``(n, n_torques)``.
        a: accelerations, likewise.
    """

    torque: Array
    v: Array
    a: Array


def shares_left(torque: Array, model: Array, v: Array, a: Array) -> Array:
    """Share of each torque's power that the model and the joint's own drive leave.

    The model's gain is free within :data:`_GAIN`, an offset is free; friction takes power out and rotors are heavy:
    these coefficients are not negative. So a torque with its sign turned is explained by nothing.

    Args:
        torque: measured, ``(n, m)`` [N·m].
        model: nominal, ``(n, m)`` [N·m].
        v: velocities of the joints, ``(n, m)``; ``a`` their accelerations.

    Returns:
        ``(m,)``; one for a torque that never changes.
    """
    y = torque - torque.mean(axis=0)
    power = (y**2).sum(axis=0)
    # A torque that never changes, filters' rounding aside, is explained by nothing.
    dead = power <= _DEAD * (torque**2).sum(axis=0)
    columns = np.stack([model, v, smooth_sign(v, WIDTH), a], axis=1).transpose(2, 1, 0)
    columns = columns - columns.mean(axis=2, keepdims=True)
    scale = np.maximum(np.sqrt((columns**2).sum(axis=2)), 1e-300)
    scaled = columns / scale[:, :, None]
    rest = y.T - _GAIN[0] * columns[:, 0]
    grams = scaled @ scaled.transpose(0, 2, 1)
    rights = (scaled @ rest[:, :, None])[:, :, 0]
    most = (_GAIN[1] - _GAIN[0]) * scale[:, 0]
    # The normal equations' root is all that the small problems need; a trace of regularisation keeps them regular.
    grams += _TRACE
    roots = np.linalg.cholesky(grams)
    targets = np.linalg.solve(roots, rights[:, :, None])[:, :, 0]
    weights = np.zeros_like(scale)
    for j in np.flatnonzero(~dead):
        weights[j] = nnls(roots[j].T, targets[j])[0]
        if weights[j, 0] > most[j]:
            root = np.linalg.cholesky(grams[j, 1:, 1:])
            others = rights[j, 1:] - most[j] * grams[j, 1:, 0]
            weights[j] = most[j], *nnls(root.T, np.linalg.solve(root, others))[0]
    rest -= (weights[:, None] @ scaled)[:, 0]
    return np.where(dead, 1.0, (rest**2).sum(axis=1) / np.where(dead, 1.0, power))


def drive_fit(torque: Array, model: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Least-squares weights of model, offset, viscous and dry friction and inertia ``(5,)``, and the friction ``(n,)``.

    Args:
        torque: measured, ``(n,)`` [N·m].
        model: nominal, ``(n,)`` [N·m].
        v: velocity of the joint, ``(n,)``; ``a`` its acceleration. The weights may have any sign.
    """
    columns = np.column_stack([model, np.ones_like(v), v, smooth_sign(v, WIDTH), a])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, torque, rcond=1e-10)[0] / scale
    return weights, columns[:, 2:4] @ weights[2:4]
