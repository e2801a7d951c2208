"""Residuals of the torques under readings that differ in one thing: a joint's zero, gravity or the clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from excite.arrays import Array
from excite.doctor.inertial_prior import half_log
from excite.doctor.model_comparison import Drive, shares_left

# Readings that differ in one thing, a joint's zero, gravity or the clock: what they leave, from a few
# motions.
#
# Torques are linear in what these change once it is written out, so that those of many readings are mixtures
# of few.

# Bodies beyond a joint turn with it, their first moments with the angle, their inertias with its double, and with these
# every torque: trigonometric polynomials of second degree in the joint's angle, which five angles determine [rad].
_DEGREE = 2
TURNS = tuple(float(angle) for angle in 2.0 * np.pi * np.arange(2 * _DEGREE + 1) / (2 * _DEGREE + 1))


def turned(angles: Array) -> Array:
    """Weights of the values at :data:`TURNS` in those at angles ``(k,)``: ``(k, 5)``.

    Trigonometric interpolation at evenly spaced angles.
    """
    away = np.asarray(angles, dtype=float)[:, None] - np.array(TURNS)
    return np.asarray(1.0 + 2.0 * np.cos(away) + 2.0 * np.cos(2.0 * away)) / len(TURNS)


def affine(values: Array) -> Array:
    """Weights of a constant and of the values' components, for values ``(k, d)``: ``(k, 1 + d)``."""
    return np.column_stack([np.ones(len(values)), values])


def mixed_power(rests: Sequence[Array], mixtures: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Half the logarithm of the mean squares of mixtures of residuals, as a function: ``(k, m)``.

    Args:
        rests: the residuals that are mixed, ``(n, m)`` each.
        mixtures: what makes weights of the residuals, ``(k, r)``, of what the function is asked for.
    """
    parts = np.stack(rests).transpose(2, 0, 1)
    products = parts @ parts.transpose(0, 2, 1) / parts.shape[2]

    def left(values: Array) -> Array:
        weights = mixtures(values)
        return half_log(((weights @ products) * weights).sum(axis=2).T)

    return left


def by_zero(torque: Array, models: Sequence[Array], drive: Drive) -> Callable[[Array], Array]:
    """What is left, as a function of angles added to a joint's zero ``(k,)`` [rad]: ``(k, m)``.

    Args:
        torque: measured, ``(n, m)``.
        models: with each of :data:`TURNS` added, ``(n, m)`` each.
        drive: motions of the joints.
    """
    parts = np.stack(models)
    return lambda angles: half_log(shares_left(torque, parts, drive, turned(angles)))


def by_gravity(
    torque: Array, still: Array, pulled: Sequence[Array], drive: Drive
) -> Callable[[Array], Array]:
    """What is left, as a function of gravities ``(k, 3)`` [m/s²]: ``(k, m)``.

    Args:
        torque: measured, ``(n, m)``.
        still: model without gravity, ``(n, m)``; ``pulled`` with one of 1 m/s² along each axis.
        drive: motions of the joints.
    """
    parts = np.stack([still, *(model - still for model in pulled)])
    return lambda gravities: half_log(shares_left(torque, parts, drive, affine(gravities)))


def by_clock(torque: Array, model: Array, weight: Array, drive: Drive) -> Callable[[float], Array]:
    """What is left, as a function of the factor by which the clock's unit grows: ``(m,)``.

    Weights stay; all else of the torques goes with the square of the speeds.

    Args:
        torque: measured, ``(n, m)``.
        model: with the clock as it is, ``(n, m)``; ``weight`` that of the robot standing.
        drive: motions of the joints.
    """
    parts = np.stack([weight, model - weight])

    def left(factor: float) -> Array:
        moved = Drive(drive.v / factor, drive.sign, drive.a / factor**2)
        return half_log(shares_left(torque, parts, moved, np.array([[1.0, factor**-2]]))[0])

    return left
