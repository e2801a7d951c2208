"""Gains, a load and all that is linear given them, by variable projection on condensed rows of two logs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from excite.arrays import Array
from excite.identification.load.load_pair import Condensed
from excite.identification.regression import RANK_TOLERANCE, minimum_norm, square_factor

_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """Gains and load of some rows.

    Attributes:
        gains: ``(n_joints,)`` torque per current, or per logged torque.
        load: ``(10,)`` about the last joint's frame, pinocchio's order [SI].
        seen: ``(10,)`` share of each that the rows let be told from all else.
        residual: ``(n_joints,)`` root mean square of what is left.
    """

    gains: Array
    load: Array
    seen: Array
    residual: Array


def solve_load(condensed: Condensed, load_mass: float | None, gains: Array | None) -> LoadSolution:
    """Least squares on the currents; gains are searched, all else is linear given them (variable projection).

    Args:
        condensed: rows without and with the load.
        load_mass: [kg], None where it is to be found.
        gains: ``(n_joints,)``, None where they are to be found, which the load's mass allows.
    """
    n = len(condensed.factors)
    std = np.ones(n)
    inverse = np.full(n, 0.1) if gains is None else 1.0 / gains
    for _ in range(_ROUNDS):
        if gains is None:
            # Gains are positive and of any size: search their logarithms.
            found = least_squares(
                lambda x, std=std: _linear(condensed, np.exp(x), std, load_mass).rest, np.log(inverse)
            )
            inverse = np.exp(found.x)
        inner = _linear(condensed, inverse, std, load_mass)
        left = inner.rest.reshape(n, -1) * std[:, None]
        rms = np.sqrt((left**2).sum(axis=1) / np.maximum(condensed.counts, 1))
        std = np.maximum(rms, 1e-6 * rms.max())
    return LoadSolution(1.0 / inverse, inner.load, inner.seen(), rms)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Solution for given gains: what it leaves, the load, the scaled columns of what was free, how much was known."""

    rest: Array
    load: Array
    columns: Array
    known: int

    def seen(self) -> Array:
        """As of :class:`LoadSolution`; the search asks for a hundred solutions, and this of the last."""
        return np.concatenate([np.ones(self.known), _seen(self.columns, 10 - self.known)])


def _linear(condensed: Condensed, inverse: Array, std: Array, load_mass: float | None) -> _Linear:
    """Base parameters, load and drives for given ``1/gain``; what is left, weighted, ``(n_joints·w,)``."""
    factors, base = condensed.factors, condensed.n_base
    n, width, _ = factors.shape
    n_drive = width - 1 - base - 10
    # Load first: its mass is known or not; then base parameters; then each joint's drive by itself.
    matrix = np.zeros((n * width, 10 + base + n * n_drive))
    target = np.zeros(n * width)
    for c in range(n):
        rows = slice(c * width, (c + 1) * width)
        r = factors[c] / std[c]
        matrix[rows, :10] = inverse[c] * r[:, base : base + 10]
        matrix[rows, 10 : 10 + base] = inverse[c] * r[:, :base]
        start = 10 + base + c * n_drive
        matrix[rows, start : start + n_drive] = r[:, base + 10 : -1]
        target[rows] = r[:, -1]
    known = 0
    if load_mass is not None:
        target, known = target - load_mass * matrix[:, 0], 1
    free = matrix[:, known:]
    scale = np.maximum(np.linalg.norm(free, axis=0), 1e-300)
    columns = free / scale
    solution = minimum_norm(columns, target) / scale
    load = solution[:10] if load_mass is None else np.concatenate([[load_mass], solution[:9]])
    return _Linear(target - free @ solution, load, columns, known)


def _seen(matrix: Array, count: int) -> Array:
    """Share of each of the first columns' parameters that lies in the row space, ``(count,)``."""
    _, size, rows = np.linalg.svd(square_factor(matrix), full_matrices=False)
    return np.asarray((rows[size > RANK_TOLERANCE * size[0], :count] ** 2).sum(axis=0))
