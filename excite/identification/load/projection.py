"""Gains, loads and all that is linear given them, by variable projection on condensed rows of all logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from excite.arrays import Array
from excite.identification.load.load_runs import Condensed
from excite.identification.regression import RANK_TOLERANCE, minimum_norm, square_factor

_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """Gains and loads of some rows.

    Attributes:
        gains: ``(n_joints,)`` torque per current, or per logged torque.
        loads: ``(n_loads, 10)`` about the last joint's frame, pinocchio's order [SI].
        seen: ``(n_loads, 10)`` share of each that the rows let be told from all else.
        residual: ``(n_joints,)`` root mean square of what is left.
    """

    gains: Array
    loads: Array
    seen: Array
    residual: Array


def solve_loads(
    condensed: Condensed, masses: Sequence[float | None], gains: Array | None, start: Array | None = None
) -> LoadSolution:
    """Least squares on the currents; gains are searched, all else is linear given them (variable projection).

    Args:
        condensed: rows without and with the loads.
        masses: of the loads [kg], None where one is to be found.
        gains: ``(n_joints,)``, None where they are to be found, which one load's mass allows.
        start: ``(n_joints,)`` gains to begin the search at.
    """
    n = len(condensed.factors)
    judged = _without_drives(condensed)
    std = np.ones(n)
    inverse = np.full(n, 0.1) if gains is None else 1.0 / gains
    if gains is None and start is not None:
        inverse = 1.0 / start
    for _ in range(_ROUNDS):
        if gains is None:
            # Gains are positive and of any size: search their logarithms.
            found = least_squares(
                lambda x, std=std: _linear_solution(judged, np.exp(x), std, masses).rest, np.log(inverse)
            )
            inverse = np.exp(found.x)
        inner = _linear_solution(condensed, inverse, std, masses)
        left = inner.rest.reshape(n, -1) * std[:, None]
        rms = np.sqrt((left**2).sum(axis=1) / np.maximum(condensed.counts, 1))
        std = np.maximum(rms, 1e-6 * rms.max())
    return LoadSolution(1.0 / inverse, inner.loads, inner.seen(), rms)


def _without_drives(condensed: Condensed) -> Condensed:
    """The rows without what each joint's drive explains, whatever gains and loads are.

    A drive's columns stand in its own joint's rows alone, and no gain scales them: they are projected out once, and the
    search is left with base parameters and loads.
    """
    factors, drives = condensed.factors, condensed.n_base + 10 * condensed.n_loads
    kept = []
    for rows in factors:
        columns, rest = rows[:, drives:-1], np.delete(rows, np.s_[drives:-1], axis=1)
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        space, size, _ = np.linalg.svd(columns / scale, full_matrices=False)
        space = space[:, size > RANK_TOLERANCE * max(1.0, *size)]
        kept.append(square_factor(rest - space @ (space.T @ rest)))
    return Condensed(np.stack(kept), condensed.counts, condensed.n_base, condensed.n_loads)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Solution for given gains: what it leaves, the loads, the scaled columns of what was free, what of loads was."""

    rest: Array
    loads: Array
    columns: Array
    free: NDArray[np.bool_]

    def seen(self) -> Array:
        """As of :class:`LoadSolution`; the search asks for a hundred solutions, and this of the last."""
        shares = np.ones(self.free.shape)
        shares[self.free] = _seen_share(self.columns, int(self.free.sum()))
        return shares


def _linear_solution(
    condensed: Condensed, inverse: Array, std: Array, masses: Sequence[float | None]
) -> _Linear:
    """Base parameters, loads and drives for given ``1/gain``; what is left, weighted, ``(n_joints·w,)``."""
    factors, base, loads = condensed.factors, condensed.n_base, 10 * condensed.n_loads
    n, width, _ = factors.shape
    n_drive = width - 1 - base - loads
    # Loads first: their masses are known or not; then base parameters; then each joint's drive by itself.
    matrix = np.zeros((n * width, loads + base + n * n_drive))
    target = np.zeros(n * width)
    for c in range(n):
        rows = slice(c * width, (c + 1) * width)
        r = factors[c] / std[c]
        matrix[rows, :loads] = inverse[c] * r[:, base : base + loads]
        matrix[rows, loads : loads + base] = inverse[c] * r[:, :base]
        start = loads + base + c * n_drive
        matrix[rows, start : start + n_drive] = r[:, base + loads : -1]
        target[rows] = r[:, -1]
    found = np.zeros((condensed.n_loads, 10))
    free = np.ones(found.shape, dtype=bool)
    for k, mass in enumerate(masses):
        if mass is not None:
            found[k, 0], free[k, 0] = mass, False
            target = target - mass * matrix[:, 10 * k]
    columns = matrix[:, np.concatenate([free.ravel(), np.ones(matrix.shape[1] - loads, dtype=bool)])]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    solution = minimum_norm(columns / scale, target) / scale
    found[free] = solution[: free.sum()]
    return _Linear(target - columns @ solution, found, columns / scale, free)


def _seen_share(matrix: Array, count: int) -> Array:
    """Share of each of the first columns' parameters that lies in the row space, ``(count,)``."""
    _, size, rows = np.linalg.svd(square_factor(matrix), full_matrices=False)
    return np.asarray((rows[size > RANK_TOLERANCE * size[0], :count] ** 2).sum(axis=0))
