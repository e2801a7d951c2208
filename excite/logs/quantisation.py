"""The step of a channel that a sensor, or a file with few digits, has quantised."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from excite.arrays import Array
from excite.logs.signals.resample import cubic_misfit

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


# The step of a sensor whose readings a file has rounded to its own, finer grid.

# Cells of the file's grid that are looked at, more where they hold fewer levels than tell a period.
_CELLS, _MOST_CELLS, _LEVELS = 2**14, 2**20, 30
# Frequencies between two of the transform's, so that the height of a peak between them is seen to 3 %.
_FINER = 4
# Parts of a step that tell it as well as its cells do: they cohere by 0.90 of what cells do.
_CELLS_A_STEP = 4
# Levels that rounding moves by up to half a cell g cohere by sin(πg/s)/(πg/s), 0.64 at a step s of two cells.
_COHERENT = 0.6
# Fewer steps in the stretch that is looked at are its own shape.
_FEWEST_STEPS = 12
# Peaks that are tried, from the longest period: a step has overtones.
_TRIED = 8
# Levels of text are exact to a few units of double precision; the finest grid looked for, as a share of the largest.
_EXACT, _FINEST = 1e-15, 1e-10
# A remainder this near to zero or to a cell, in cells, that its own error may have made tells nothing.
_TOLD = 0.1
# Shortest distances, whose grid is nearly always that of all, and how often others are taken in.
_SHORTEST, _PASSES = 64, 8


def cell_of(levels: Array) -> float:
    """Largest number of which all levels are multiples apart, to double precision; 0 where there is none.

    Args:
        levels: ``(n,)`` different values, sorted.
    """
    distance, error = np.diff(levels), _EXACT * float(np.abs(levels[[0, -1]]).max())
    few = np.sort(distance)[:_SHORTEST]
    for _ in range(_PASSES):
        cell = _common_divisor(few, error)
        if cell <= 0.0:
            return 0.0
        off = np.abs(distance - cell * np.rint(distance / cell))
        odd = off > _TOLD * cell
        if not odd.any():
            return cell
        few = np.append(few, distance[odd].min())
    return 0.0


def _common_divisor(distance: Array, error: float) -> float:
    """Greatest common divisor of distances that are each off by ``error``, by Euclid's algorithm; 0 for none."""
    cell, own = float(distance.min()), error
    while cell > _FINEST / _EXACT * error:
        count = np.rint(distance / cell)
        off, bound = np.abs(distance - cell * count), own * count + error
        rest = np.flatnonzero(off > bound)
        if not len(rest):
            # A mean over all that are short enough is as exact as they are together.
            near = bound < _TOLD * cell
            return float(distance[near].sum() / count[near].sum()) if near.any() else 0.0
        least = rest[np.argmin(off[rest])]
        cell, own = float(off[least]), float(bound[least])
        if own > _TOLD * cell:
            return 0.0
    return 0.0


def rounded_step(levels: Array, cell: float, least: float = 0.0) -> float:
    """Step of the sensor of whose levels all are the roundings to the file's grid; ``cell`` where there is none.

    Levels of a sensor with the step ``s`` are ``start + s k``; the file holds its cells that are nearest to them.
    Such levels, in cells, cohere at the frequency ``cell/s``. A step that is found so is believed where every level is
    within half a cell of a multiple of its own, which chance does with ``(cell/s)^n``.

    Args:
        levels: ``(n,)`` different values, sorted.
        cell: of which all levels are multiples apart, same unit.
        least: smallest step that matters, same unit.
    """
    number = np.rint((levels - levels[0]) / cell)
    # Cells are looked at together where a step that matters is many of them.
    width = max(1, int(least / cell / _CELLS_A_STEP))
    few = number[_densest_stretch(number // width)]
    if len(few) < _LEVELS:
        return cell
    at = ((few - few[0]) // width).astype(np.intp)
    cells = int(at[-1]) + 1
    size = _FINER * 2 ** int(np.ceil(np.log2(cells)))
    wave = np.fft.rfft(np.bincount(at), size)
    power = wave.real**2 + wave.imag**2
    high = np.flatnonzero(power > (_COHERENT * len(few)) ** 2)
    high = high[high >= _FEWEST_STEPS * size / cells]
    around = sliding_window_view(np.pad(power, _FINER), 2 * _FINER + 1)
    peaks = high[power[high] == around[high].max(axis=1)]
    for k in peaks[:_TRIED]:
        step = _fit_period(number, few, width * size / float(k))
        if step > 0.0:
            return step * cell
    return cell


def _densest_stretch(number: Array) -> slice:
    """Which levels are in the stretch of few cells that holds most, or in a longer one if these are too few."""
    cells = _CELLS
    while True:
        last = np.searchsorted(number, number + cells)
        first = int(np.argmax(last - np.arange(len(number))))
        few = int(last[first]) - first
        if few >= _LEVELS or cells >= _MOST_CELLS or few == len(number):
            return slice(first, first + few)
        cells *= 4


def _band_width(count: Array, rest: Array) -> float:
    """How far levels lie apart across the line along which they lie nearest together [cells].

    Rounding moves each by half a cell at most: a sensor's lie within one cell of some line. What least squares leaves
    is more than that where levels are few, and no bound for chance where it may be.
    """
    from scipy.optimize import minimize_scalar  # lazy: scipy

    place = (count - count.mean()) / max(float(np.ptp(count)), 1.0)
    across = minimize_scalar(
        lambda turn: float(np.ptp(rest - turn * place)), bounds=(-1.0, 1.0), method="bounded"
    )
    # The search stops some 1e-5 short of the narrowest.
    return float(across.fun) - 1e-4


def _fit_period(number: Array, few: Array, period: float) -> float:
    """The period of all levels [cells], from one that holds for a few; 0 where one is off its multiple's rounding."""
    start = float(few[0])
    low, high = float(few[0]), float(few[-1])
    while True:
        inside = number[(number >= low) & (number <= high)]
        if len(inside) < _LEVELS:
            return 0.0
        # The second time from a period that no longer misplaces a level at an end.
        for _ in range(2):
            count = np.rint((inside - start) / period)
            period, start = np.polyfit(count, inside, 1)
        if (np.diff(count) < 1.0).any():
            return 0.0
        if _band_width(count, inside - start - period * count) > 1.0:
            return 0.0
        if len(inside) == len(number):
            return float(period)
        span = high - low
        low, high = low - span, high + span
