"""Twist and acceleration of a floating base from its measured pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.logs.signals.butterworth import central_differences, lowpass


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of a base in pinocchio's free-flyer convention.

    Attributes:
        pose: ``(n, 7)``: x y z [m], qx qy qz qw, world frame.
        twist: ``(n, 6)``: linear [m/s] and angular [rad/s] velocity of the base's origin, base frame.
        acceleration: ``(n, 6)``: time derivative of ``twist``'s components (spatial acceleration in the
            base frame) [m/s², rad/s²].
    """

    pose: Array
    twist: Array
    acceleration: Array


def base_motion(pose: Array, rate_hz: float, cutoff_hz: float, order: int = 4) -> BaseMotion:
    """Filter a pose and differentiate it twice.

    Position and sign-continuous quaternion are filtered with the same zero-phase filter, the quaternion is
    normalised, and with p, R, q̄ position, rotation and conjugate quaternion: v = Rᵀṗ, ω = 2 vec(q̄ q̇),
    dv/dt = Rᵀp̈ − ω×v, dω/dt = 2 vec(q̄ q̈) (q̇̄ q̇ is real, so nothing else is left).

    Args:
        pose: ``(n, 7)`` uniformly sampled, as in :class:`BaseMotion`; unit quaternions of either sign.
        rate_hz: sampling rate [Hz].
        cutoff_hz: cut-off of the filter [Hz].
        order: its order.

    Returns:
        The motion; near both ends it carries the filter's transient.

    Raises:
        LogError: the record is shorter than the filter needs.
    """
    smooth = lowpass(np.hstack([pose[:, :3], continuous_quaternions(pose[:, 3:])]), rate_hz, cutoff_hz, order)
    smooth[:, 3:] /= np.linalg.norm(smooth[:, 3:], axis=1, keepdims=True)
    d = central_differences(smooth, rate_hz)
    quaternion = smooth[:, 3:]
    omega = 2.0 * _conjugate_product(quaternion, d.first[:, 3:])
    alpha = 2.0 * _conjugate_product(quaternion, d.second[:, 3:])
    velocity = _rotate_back(quaternion, d.first[:, :3])
    linear = _rotate_back(quaternion, d.second[:, :3]) - np.cross(omega, velocity)
    return BaseMotion(smooth, np.hstack([velocity, omega]), np.hstack([linear, alpha]))


def continuous_quaternions(quaternions: Array) -> Array:
    """Flip signs so that neighbours lie on the same half of the sphere, ``(n, 4)``."""
    dots = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0.0, -1.0, 1.0)]))
    return quaternions * signs[:, None]


def _conjugate_product(q: Array, r: Array) -> Array:
    """Vector part of conj(q)·r, ``(n, 3)``, quaternions x y z w."""
    return q[:, 3:] * r[:, :3] - r[:, 3:] * q[:, :3] - np.cross(q[:, :3], r[:, :3])


def _rotate_back(q: Array, vectors: Array) -> Array:
    """Rᵀ v for each row, ``(n, 3)``."""
    twice = 2.0 * np.cross(-q[:, :3], vectors)
    return vectors + q[:, 3:] * twice + np.cross(-q[:, :3], twice)
