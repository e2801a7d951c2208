"""One joint's torque beside the nominal model's: what model and drive explain of it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from excite.arrays import Array
from excite.rows.drive_terms import smooth_sign

# Nominal masses are believed within these factors.
_GAIN = (0.5, 2.0)
# A torque whose power is all but this share in its mean is a dead channel.
_DEAD = 1e-12
# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02


def share_left(torque: Array, model: Array, v: Array, a: Array) -> float:
    """Share of a torque's power that the model and the joint's own drive leave.

    The model's gain is free within :data:`_GAIN`, an offset is free; friction takes power out and rotors are heavy:
    these coefficients are not negative. So a torque with its sign turned is explained by nothing.

    Args:
        torque: measured, ``(n,)`` [N·m].
        model: nominal, ``(n,)`` [N·m].
        v: velocity of the joint, ``(n,)``; ``a`` its acceleration.
    """
    y = torque - torque.mean()
    power = float(y @ y)
    # A torque that never changes, filters' rounding aside, is explained by nothing.
    if power <= _DEAD * float(torque @ torque):
        return 1.0
    columns = np.column_stack([model, v, smooth_sign(v, WIDTH), a])
    columns -= columns.mean(axis=0)
    y = y - _GAIN[0] * columns[:, 0]
    scale = np.maximum(np.sqrt((columns**2).sum(axis=0)), 1e-300)
    scaled = columns / scale
    # The normal equations' root is all that the small problem needs; a trace of regularisation keeps it regular.
    root = np.linalg.cholesky(scaled.T @ scaled + 1e-9 * np.eye(4))
    target = np.linalg.solve(root, scaled.T @ y)
    found = nnls(root.T, target)[0]
    most = (_GAIN[1] - _GAIN[0]) * scale[0]
    if found[0] > most:
        y = y - (_GAIN[1] - _GAIN[0]) * columns[:, 0]
        root = np.linalg.cholesky(scaled[:, 1:].T @ scaled[:, 1:] + 1e-9 * np.eye(3))
        found = np.append(0.0, nnls(root.T, np.linalg.solve(root, scaled[:, 1:].T @ y))[0])
    rest = y - scaled @ found
    return float(rest @ rest) / power


def drive_fit(torque: Array, model: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Least-squares weights of model, offset, viscous and dry friction and inertia ``(5,)``, and the friction ``(n,)``.

    Args and shapes as of :func:`share_left`; the weights may have any sign.
    """
    columns = np.column_stack([model, np.ones_like(v), v, smooth_sign(v, WIDTH), a])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, torque, rcond=1e-10)[0] / scale
    return weights, columns[:, 2:4] @ weights[2:4]
