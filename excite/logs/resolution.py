"""The step of a channel that a sensor, or a file with few digits, has quantised."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.logs.lattice import cell_of, rounded_step
from excite.logs.signals.clock import cubic_misfit

_FEW_ROWS, _FEW_LEVELS = 200, 200
# Steps below this share of the noise add less than one per cent to its variance (a twelfth of the squared step).
_COARSE = 0.3
# Levels lie this near to a common grid [steps]; those of a smooth channel are 0.29 away.
_ON_GRID = 0.05
# Stamps of single precision do not part levels.
_ROUNDING = 1e-7
_SHORT, _REMAINDERS = 20.0, 30
# Numbers that are looked at together: their neighbours and distances take some dozen times their memory.
_AT_ONCE = 1_000_000


def coarse_step(values: Array, noise: float) -> float:
    """Step of a quantised channel, 0 where none shows or matters.

    All values of such a channel lie on a grid, or next to one, where the file's digits round them. Any file has one in
    its last digit: it matters where the step is no smaller than the noise beside it, or where the channel takes few
    values at all.

    Args:
        values: ``(n,)``.
        noise: standard deviation of the channel's noise, same unit.

    Returns:
        The step, same unit.
    """
    levels = np.unique(values)
    apart = np.concatenate([[True], np.diff(levels) > _ROUNDING * np.abs(levels).max()])
    levels = levels[apart]
    if len(values) < _FEW_ROWS or len(levels) < 3:
        return 0.0
    few = len(levels) < min(_FEW_LEVELS, len(values) // 5)
    # A limit at which a channel is clipped need not be on the grid.
    inner = levels[1:-1] if len(levels) > 10 else levels
    least = 0.0 if few else _COARSE * noise
    cell = cell_of(inner)
    step = rounded_step(inner, cell, least) if cell > 0.0 else 0.0
    if step > 1.5 * cell:
        return step if step >= least else 0.0
    return _common_step(inner, least)


def channel_noise(time: Array, channels: Sequence[Array]) -> list[float]:
    """Standard deviation of each channel's noise about smooth curves.

    Over the stamps or over the row's number, whichever is smoother: stamps may be late.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].
        channels: ``(n,)`` each.
    """
    rows = np.arange(len(time), dtype=float)
    together = max(1, _AT_ONCE // max(len(time), 1))
    found: list[float] = []
    for start in range(0, len(channels), together):
        values = np.column_stack(channels[start : start + together])
        sizes = [np.median(np.abs(cubic_misfit(clock, values)), axis=0) for clock in (time, rows)]
        found += (1.4826 * np.minimum(*sizes)).tolist()
    return found


def _common_step(levels: Array, least: float) -> float:
    """Largest step of which all distances between levels are multiples, 0 if none of ``least`` or more."""
    distance = np.diff(levels)
    least = max(least, 10.0 * _ROUNDING * float(np.abs(levels).max()))
    step = float(distance.min())
    for _ in range(_REMAINDERS):
        if step < least:
            return 0.0
        short = distance[distance < _SHORT * step]
        off = np.abs(short - step * np.rint(short / step))
        if (off < 2.0 * _ON_GRID * step).all():
            break
        # As in Euclid's algorithm: what divides both divides the remainder.
        step = float(off[off >= 2.0 * _ON_GRID * step].min())
    number = np.concatenate([[0.0], np.cumsum(np.rint(distance / step))])
    step, start = np.polyfit(number, levels, 1)
    away = levels - (start + step * number)
    return float(step) if np.sqrt(np.mean(away**2)) < _ON_GRID * step else 0.0
