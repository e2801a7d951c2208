"""From jittered stamps to a uniform grid, and what else is put right in samples before they are filtered."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array, Flags
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


def near_samples(time: Array, grid: Array, longest_gap_s: float) -> Flags:
    """Which grid points lie in an interval between samples of at most ``longest_gap_s``, ``(m,)``."""
    index = np.clip(np.searchsorted(time, grid, side="right"), 1, len(time) - 1)
    return (time[index] - time[index - 1]) <= longest_gap_s


# Cutting off standstill before and after a motion.


def moving_span(velocity: Array, threshold: float) -> slice:
    """Samples from the first to the last at which any joint moves.

    Args:
        velocity: ``(n, n_joints)`` [rad/s or m/s].
        threshold: speed above which a joint counts as moving, same unit.

    Returns:
        The slice.

    Raises:
        LogError: no joint ever moves.
    """
    moving = np.flatnonzero((np.abs(velocity) > threshold).any(axis=1))
    if len(moving) == 0:
        raise LogError(
            f"no joint is ever faster than {threshold:g} rad/s",
            field="q",
            remedy="record a motion, or lower the standstill velocity",
        )
    return slice(int(moving[0]), int(moving[-1]) + 1)


def long_standstill(velocity: Array, threshold: float, shortest: int) -> Flags:
    """Samples in stretches of at least ``shortest`` samples in which a joint stands, ``(n, n_joints)``.

    There its friction is anything up to the breakaway torque and says nothing; a mere change of direction is
    shorter.

    Args:
        velocity: ``(n, n_joints)`` [rad/s or m/s].
        threshold: speed below which a joint counts as standing, same unit.
        shortest: shortest stretch [samples].
    """
    from scipy.ndimage import binary_opening

    slow = np.abs(velocity) < threshold
    return np.asarray(binary_opening(slow, np.ones((shortest, 1), dtype=bool)))


# Angles that jump by whole turns, where an encoder passes the end of its count or a driver keeps within a turn.

# A jump leaves out what the joint moves in a row, below a tenth of a turn at 25 Hz and 15 rad/s; a joint that swings
# about the seam at 2 Hz jumps in every sixth row then.
_MOST, _SELDOM = 0.9, 0.17


def without_seams(
    values: Array, turn: float, *, within: bool = False, time: Array | None = None
) -> Array | None:
    """An angle that jumps by whole turns, going on; None where it is none.

    It jumps by whole turns now and then, and moves by little from row to row else, over the seam as well.

    Args:
        values: ``(n,)``; rows that are not finite stay.
        turn: what a turn is in their unit.
        within: whether it has to stay within a turn, and to cover it: of numbers that may be no angle.
        time: ``(n,)`` of the rows, of which some may be missing; even by default.

    Returns:
        ``(n,)`` with whole turns added, none to the first.
    """
    known = np.isfinite(values)
    rows = np.flatnonzero(known) if time is None else time[known] / np.median(np.diff(time))
    steps, passed = np.diff(values[known]), np.maximum(np.diff(rows), 1.0)
    far = np.abs(steps) > 0.5 * turn
    if not far.any() or far.mean() > _SELDOM:
        return None
    if within and not _MOST * turn < np.ptp(values[known]) < 1.001 * turn:
        return None
    # A turn as it is written, in numbers of few digits, is none that can be taken off.
    turns = np.where(far, np.round(steps / turn), 0.0)
    over = (np.abs(steps - turns * turn) / passed)[far]
    fastest = (np.abs(steps) / passed)[~far].max(initial=0.0)
    # A clock that starts anew jumps by any length, and not by a turn less than a step.
    if not 0.0 < fastest < (1.0 - _MOST) * turn or (over > 2.0 * fastest).any():
        return None
    whole = values.copy()
    whole[known] -= turn * np.concatenate([[0.0], np.cumsum(turns)])
    return np.asarray(whole)


def cubic_misfit(time: Array, values: Array) -> Array:
    """Distance of each sample from the cubic through two neighbours on either side, ``(n − 4, …)``.

    Scaled so that white noise of standard deviation 1 gives 1.
    """
    n = len(time)
    centre = time[2 : n - 2]
    places = [slice(0, n - 4), slice(1, n - 3), slice(3, n - 1), slice(4, n)]
    nodes = np.stack([time[place] for place in places])
    weights = np.ones_like(nodes)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (centre - nodes[j]) / (nodes[i] - nodes[j])
    shape = (-1,) + (1,) * (values.ndim - 1)
    predicted = sum(w.reshape(shape) * values[place] for w, place in zip(weights, places, strict=True))
    scale = np.sqrt(1.0 + (weights**2).sum(axis=0)).reshape(shape)
    return np.asarray((values[2 : n - 2] - predicted) / scale)
