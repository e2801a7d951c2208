"""From jittered stamps to a uniform grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError


def uniform_grid(time: Array, rate_hz: float) -> Array:
    """Grid of ``rate_hz`` from the first stamp to the last, ``(m,)`` [s]."""
    n = int(np.floor((time[-1] - time[0]) * rate_hz + 1e-6)) + 1
    return np.asarray(time[0] + np.arange(n) / rate_hz)


def is_uniform(time: Array, rate_hz: float) -> bool:
    """Whether stamps lie on a grid of ``rate_hz`` to a thousandth of a step."""
    grid = time[0] + np.arange(len(time)) / rate_hz
    return bool(np.abs(time - grid).max() * rate_hz < 1e-3)


def resample_noisy(time: Array, values: Array, grid: Array) -> Array:
    """Interpolate noisy samples on a grid inside their span by monotone cubics (PCHIP).

    They never overshoot, unlike splines where stamps crowd.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].
        values: ``(n, …)``.
        grid: ``(m,)`` [s].

    Returns:
        ``(m, …)``.

    Raises:
        LogError: the grid reaches outside the stamps.
    """
    from scipy.interpolate import PchipInterpolator

    return np.asarray(PchipInterpolator(time, values)(_clip_to_span(time, grid)))


def resample_smooth(time: Array, values: Array, grid: Array) -> Array:
    """Interpolate samples with little noise, such as encoders', by a cubic spline.

    Its error falls with the fourth power of the interval, which second derivatives need. Arguments, result
    and errors are those of :func:`resample_noisy`.
    """
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time, values)(_clip_to_span(time, grid)))


def _clip_to_span(time: Array, grid: Array) -> Array:
    slack = 1e-9 * max(1.0, abs(time[-1]))
    if grid[0] < time[0] - slack or grid[-1] > time[-1] + slack:
        raise LogError(
            f"the grid {grid[0]:.4g} … {grid[-1]:.4g} s leaves the samples {time[0]:.4g} … {time[-1]:.4g} s",
            field="time",
        )
    return np.clip(grid, time[0], time[-1])


def near_samples(time: Array, grid: Array, longest_gap_s: float) -> NDArray[np.bool_]:
    """Which grid points lie in an interval between samples of at most ``longest_gap_s``, ``(m,)``."""
    index = np.clip(np.searchsorted(time, grid, side="right"), 1, len(time) - 1)
    return (time[index] - time[index - 1]) <= longest_gap_s
