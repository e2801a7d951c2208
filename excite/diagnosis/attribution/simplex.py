"""Search without derivatives: the simplex method of Nelder and Mead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from excite.arrays import Array


class _Spent(Exception):
    """All evaluations have been made."""


def nelder_mead(
    loss: Callable[[Array], float], simplex: Array, evaluations: int, near: float, flat: float
) -> None:
    """Make a loss small (Nelder, Mead 1965); whoever asks keeps the best point that ``loss`` has been asked for.

    A loss costs a fit or more, and a search a few dozen of them; ``scipy.optimize`` takes longer to load than many
    a search runs.

    Args:
        loss: of a point ``(n,)``.
        simplex: ``(n + 1, n)`` points to begin with.
        evaluations: losses asked for at most.
        near: done when all points are within this distance of the best, in every coordinate,
        flat: and all losses within this of its own.
    """
    points, left = np.array(simplex, dtype=float), evaluations

    def asked(point: Array) -> float:
        nonlocal left
        if left <= 0:
            raise _Spent
        left -= 1
        return loss(point)

    try:
        values = np.array([asked(point) for point in points])
        while left > 0:
            order = np.argsort(values)
            points, values = points[order], values[order]
            if np.abs(points[1:] - points[0]).max() <= near and np.abs(values[1:] - values[0]).max() <= flat:
                break
            _moved(asked, points, values)
    except _Spent:
        return


def _moved(asked: Callable[[Array], float], points: Array, values: Array) -> None:
    """Replace the worst point, the last, by a better one on the line through the others' middle; else shrink."""
    middle = points[:-1].sum(axis=0) / (len(points) - 1)
    worst = points[-1].copy()
    reflected = 2.0 * middle - worst
    value = asked(reflected)
    if value < values[0]:
        further = 3.0 * middle - 2.0 * worst
        again = asked(further)
        points[-1], values[-1] = (further, again) if again < value else (reflected, value)
    elif value < values[-2]:
        points[-1], values[-1] = reflected, value
    else:
        outside = value < values[-1]
        closer = 1.5 * middle - 0.5 * worst if outside else 0.5 * middle + 0.5 * worst
        again = asked(closer)
        if again <= value if outside else again < values[-1]:
            points[-1], values[-1] = closer, again
            return
        for k in range(1, len(points)):
            points[k] = points[0] + 0.5 * (points[k] - points[0])
            values[k] = asked(points[k])
