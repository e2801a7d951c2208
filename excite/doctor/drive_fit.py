"""Torques of joints beside the nominal model's: what model and drive explain of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.doctor.share_loops import unexplained_shares
from excite.rows.drive_terms import smooth_sign

# Nominal masses are believed within these factors.
_GAIN = (0.5, 2.0)
# A torque whose power is all but this share in its mean is a dead channel.
_DEAD = 1e-12
_TRACE = 1e-9
# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02


class Drive(NamedTuple):
    """Motion of measured joints, which their drives feel.

    Attributes:
        v: velocities ``(n, n_torques)``.
        sign: of the velocities, smooth, likewise.
        a: accelerations, likewise.
    """

    v: Array
    sign: Array
    a: Array

    @classmethod
    def of(cls, v: Array, a: Array, speed: float | Array = 1.0) -> Drive:
        """From velocities and accelerations that are read as ``speed`` times what was logged, all or each joint's.

        Dry friction changes its sign over the same rows whatever the clock and the unit: its shape is not known well
        enough to tell how fast a joint is.
        """
        return cls(v, smooth_sign(v, WIDTH * speed), a)


class Predicted(NamedTuple):
    """What a model says of measured joints.

    Attributes:
        torque: of rigid bodies ``(n, n_torques)`` [N·m].
        drive: motion of the joints.
    """

    torque: Array
    drive: Drive


def shares_left(torque: Array, models: Array, drive: Drive, mixtures: Array | None = None) -> Array:
    """Share of each torque's power that the model and the joint's own drive leave.

    The model's gain is free within :data:`_GAIN`, an offset is free; friction takes power out and rotors are heavy:
    these coefficients are not negative. So a torque with its sign turned is explained by nothing.

    Args:
        torque: measured, ``(n, m)`` [N·m].
        models: nominal, ``(n, m)`` [N·m]; or parts of it, ``(k, n, m)``, with ``mixtures``.
        drive: motions of the joints, each ``(n, m)``.
        mixtures: ``(r, k)`` weights of the parts in each of several models.

    Returns:
        ``(m,)``, or ``(r, m)`` with mixtures; one for a torque that never changes.
    """
    parts = models[None] if mixtures is None else models
    weights = np.ones((1, 1)) if mixtures is None else np.asarray(mixtures, dtype=float)
    out = np.empty((len(weights), torque.shape[1]))
    # Of one layout in memory, for which alone the loops are then compiled.
    moved = (np.ascontiguousarray(values) for values in (torque, parts, weights, *drive))
    unexplained_shares(*moved, *_GAIN, _DEAD, _TRACE, out)
    return out[0] if mixtures is None else out


def shares_across(torque: Array, model: Array, drive: Drive) -> Array:
    """Share of every torque's power that every joint's model and drive leave, of either sign the better.

    Args:
        torque: measured, ``(n, m)``; ``model`` nominal, ``(n, m)`` [N·m].
        drive: motions of the joints.

    Returns:
        ``(m, m)``: of each joint as it explains each torque.
    """
    found = []
    for j in range(torque.shape[1]):
        one, *moved = (np.repeat(values[:, [j]], torque.shape[1], axis=1) for values in (model, *drive))
        either = [shares_left(turned, one, Drive(*moved)) for turned in (torque, -torque)]
        found.append(np.minimum(*either))
    return np.array(found)


def beside_drives(torque: Array, model: Array, drive: Drive) -> list[tuple[Array, Array]]:
    """Measured and modelled torque of each joint ``(n,)`` without what offset, friction and rotor explain of them.

    Args:
        torque: measured, ``(n, m)``; ``model`` nominal, ``(n, m)`` [N·m].
        drive: motions of the joints.
    """
    found = []
    for j in range(torque.shape[1]):
        columns = np.column_stack([np.ones(len(torque)), *(values[:, j] for values in drive)])
        basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
        y, x = (values - basis @ (basis.T @ values) for values in (torque[:, j], model[:, j]))
        found.append((y, x))
    return found


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
