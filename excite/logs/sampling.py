"""Clocks of a log: stamps in seconds, and gaps that no grid has to bridge at a cost that the file does not show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Indices
from excite.errors import LogError
from excite.logs.log import LogHeader, Trial

FEWEST_ROWS = 16
# Stamps closer than this are the same [s]: it is the tick of the finest clocks.
SAME_S = 1e-9
# No encoder is read more often [Hz].
_FASTEST_HZ = 1e6
# Stamps since 1970 are 1.8e9 s; those of finer clocks lie far beyond this [s].
_LATEST_S = 1e11
_SINCE_1970 = 1.8e9
_CLOCKS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
# Rates are stated with few digits; clocks that are further off are wrong in some other way.
_SAME_RATE = 1.25
# Trials are laid on a grid of their rate, gaps and all, and every step of an identification or a diagnosis takes time
# and memory by its points. Ten for each row keep a pause within a recording affordable (a diagnosis of 200 rows and a
# pause of 15 minutes at 100 Hz, 450 points a row, took 90 s); a gap of days is a hundred million points.
_POINTS_PER_ROW, _POINTS = 10, 10_000
# Stamps and ``rate_hz`` that differ so much are in different units; less is a finding, as one may be mistyped.
_OTHER_UNIT = 100.0


def check_stamps(time: Array, path: Path) -> None:
    """Refuse stamps that are no seconds; raises LogError.

    Args:
        time: ``(n,)`` finite stamps as they stand in the file.
        path: the file, for errors.
    """
    if not len(time):
        raise LogError("has no rows", source=path, field="time", remedy=f"at least {FEWEST_ROWS} are needed")
    latest = float(np.abs(time).max())
    if latest > _LATEST_S:
        near = [unit for factor, unit in _CLOCKS.items() if 0.1 < latest / (factor * _SINCE_1970) < 10.0]
        cause = f", which looks like {near[0]} since 1970" if near else ""
        raise LogError(f"reaches {latest:.6g}{cause}", source=path, field="time", remedy="write seconds")


def in_seconds(time: Array, rate_hz: float) -> tuple[Array, str]:
    """Stamps in seconds, and the unit that they were in where it was another one, else an empty word.

    The stated rate tells: stamps of a hundred rows a second that come every ten are milliseconds.

    Args:
        time: ``(n,)`` finite stamps as they stand in the file.
        rate_hz: rate that the header states [Hz].
    """
    steps = np.diff(time)
    if not len(steps):
        return time, ""
    factor = float(np.median(steps)) * rate_hz
    for scale, unit in _CLOCKS.items():
        if 1.0 / _SAME_RATE < factor / scale < _SAME_RATE:
            return time / scale, unit
    return time, ""


def check_span(time: Array, path: Path) -> None:
    """Refuse a trial whose grid would be out of proportion to its rows; raises LogError that names the longest gap.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].
        path: the file, for errors.
    """
    step = np.diff(time)
    median = float(np.median(step))
    if median * _FASTEST_HZ < 1.0:
        raise LogError(
            f"rows come every {median:.3g} s, faster than any sensor",
            source=path,
            field="time",
            remedy="write seconds",
        )
    if _too_many(float(time[-1] - time[0]) / median, len(time)):
        row = int(np.argmax(step))
        raise LogError(
            f"has a gap of {_describe_duration(float(step[row]))} after {time[row]:.6g} s, where rows come every "
            f"{median:.3g} s",
            source=path,
            field="time",
            remedy="split the recording there",
        )


def check_log_clock(trials: Sequence[Trial], header: LogHeader, path: Path) -> None:
    """Refuse trials whose clocks are in another unit than the header's rate, or than each other's; raises LogError.

    Args:
        trials: read and repaired.
        header: of the log.
        path: its ``log.yaml``, for errors.
    """
    rates = [trial.cleaning.rate_hz for trial in trials]
    fastest = int(np.argmax(rates))
    for trial, rate, entry in zip(trials, rates, header.trials, strict=True):
        factor = header.rate_hz / rate
        if not 1.0 / _OTHER_UNIT < factor < _OTHER_UNIT:
            near = [unit for scale, unit in _CLOCKS.items() if 0.5 < factor / scale < 2.0]
            raise LogError(
                f"runs at {rate:.4g} Hz, log.yaml says {header.rate_hz:g} Hz"
                + (f": time looks like {near[0]}" if near else ""),
                source=path.parent / entry.file,
                field="time",
                remedy="write seconds, or correct rate_hz",
            )
        if _too_many(float(trial.time[-1] - trial.time[0]) * rates[fastest], trial.n_samples):
            raise LogError(
                f"runs at {rate:.4g} Hz, {header.trials[fastest].file} at {rates[fastest]:.4g} Hz",
                source=path.parent / entry.file,
                field="time",
                remedy="write the stamps of both in seconds",
            )


def _too_many(points: float, rows: int) -> bool:
    return points > _POINTS_PER_ROW * rows + _POINTS


def _describe_duration(seconds: float) -> str:
    for unit, length in (("days", 86400.0), ("hours", 3600.0)):
        if seconds > 2.0 * length:
            return f"{seconds / length:.4g} {unit}"
    return f"{seconds:.4g} s"


# Rows that a record lacks: steps of its stamps that are whole periods too long.

# Rows on either side over which stamps are averaged: jitter of single stamps averages out, a hiccup of one does too.
_WINDOWS = (1, 2, 4, 8)
# No clock is better than this share of a period for the choice of a window.
_FINE = 0.1
_PASSES = 12
# Half a window of rows on one side makes means so much less certain.
_AT_END = 1.5
# So few odd steps are no tail.
_FEW = 20
# Index of the window that tells a change of level from a single late stamp.
_LEVEL = 2
# Rows that a record lacks before any is found to be missing, for the odds.
_RARE = 0.1


def missing_rows(time: Array) -> Indices:
    """How many rows are missing in each step between stamps.

    Where a row is missing, all later stamps are a period further than their number lets one expect. That change
    of level is looked for between means over some rows on either side, as many as make it clearest: jitter of
    single stamps averages out over many rows, a clock that wanders is judged by single steps. A row counts as
    missing where that is likelier than the spread of the other steps, both taken as normal and the share of gaps
    as found. What later stamps make up for, as those of packets that waited and came in a burst, is no gap.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].

    Returns:
        ``(n - 1,)`` rows missing between a stamp and the next.
    """
    step = np.diff(time)
    period = float(np.median(step))
    extra = np.zeros(len(step), dtype=np.int64)
    if np.abs(step - period).max() < 0.5 * period:
        return extra
    spreads = [_robust_deviation(_stamp_jumps(step, w)[0]) for w in _WINDOWS]
    best = int(np.argmin(np.maximum(spreads, _FINE * period)))
    if _long_tailed(step, period, _WINDOWS[best]):
        # Loops that are held up for part of a period: no single row can be told to be missing.
        return np.where(step > 2.5 * period, np.rint(step / period) - 1, 0).astype(np.int64)
    extra = _added_rows(step, period, extra, _WINDOWS[best])
    if best < _LEVEL and spreads[_LEVEL] < 0.2 * period:
        # A single stamp that is late, next to none that are, is a long step and no change of level.
        extra = _added_rows(step, period, extra, _WINDOWS[_LEVEL])
    behind = np.cumsum(extra)
    kept = np.minimum.accumulate(behind[::-1])[::-1]
    return np.diff(np.concatenate([[0], np.maximum(kept, 0)]))


def _long_tailed(step: Array, period: float, window: int) -> bool:
    """Whether jumps of half a period are so many more than normal ones would be that those of one are their tail.

    Gaps are jumps of whole periods: where rows are missing, there are more of these than between.
    """
    jump = _stamp_jumps(step, window)[0] / period
    spread = max(_robust_deviation(jump), 1e-9)
    between, whole = (
        int(np.sum((np.abs(jump - middle) < 0.1) & (jump == _highest_near(jump, window))))
        for middle in (0.5, 1.0)
    )
    tail = [math.erfc(edge / (spread * math.sqrt(2.0))) for edge in (0.4, 0.6)]
    return between - 0.5 * len(step) * (tail[0] - tail[1]) > max(whole, _FEW)


def _added_rows(step: Array, period: float, extra: Indices, window: int) -> Indices:
    """Rows missing in each step, from those found before and jumps of the level that they leave."""
    extra = extra.copy()
    for _ in range(_PASSES):
        jump, weight = _stamp_jumps(step - period * extra, window)
        spread = max(_robust_deviation(jump), 1e-9 * period)
        share = min(0.5, max(_RARE, int(np.abs(extra).sum())) / len(step))
        limit = period * (0.5 + (spread / period) ** 2 * weight * np.log(1.0 / share - 1.0))
        # So near an end one late stamp is all that there is.
        size = np.where(weight > _AT_END, 0.0, np.abs(jump))
        found = np.flatnonzero((size > limit) & (size == _highest_near(size, window)))
        # Of jumps that are equally high the first is enough.
        found = found[np.concatenate([[True], np.diff(found) > window])] if len(found) else found
        change = np.rint(jump[found] / period).astype(np.int64)
        if not change.any():
            break
        more = change > 0
        reach = window // 2
        np.add.at(extra, _largest_near(step - period * extra, found[more], reach), change[more])
        # What was no gap is taken back where it was added.
        np.add.at(extra, _largest_near(extra, found[~more], reach), change[~more])
    return extra


def _stamp_jumps(step: Array, window: int) -> tuple[Array, Array]:
    """By how much stamps after each step are further than those before it, beyond the usual step [s].

    Also by how much the variance of the means exceeds that of full windows, near the ends.
    """
    n = len(step) + 1
    level = np.concatenate([[0.0], np.cumsum(step - np.median(step))])
    total = np.concatenate([[0.0], np.cumsum(level)])
    middle = np.arange(1, n)
    first, last = np.maximum(middle - window, 0), np.minimum(middle + window, n)
    before = (total[middle] - total[first]) / (middle - first)
    after = (total[last] - total[middle]) / (last - middle)
    jump = after - before
    weight = (1.0 / (middle - first) + 1.0 / (last - middle)) / (2.0 / window)
    return jump - np.median(jump), weight


def _robust_deviation(values: Array) -> float:
    """Standard deviation by the median absolute deviation: gaps are few."""
    return 1.4826 * float(np.median(np.abs(values)))


def _largest_near(values: Array | Indices, places: NDArray[np.intp], reach: int) -> NDArray[np.intp]:
    """Where, up to ``reach`` places from each place, the largest value is."""
    near = np.clip(places[:, None] + np.arange(-reach, reach + 1), 0, len(values) - 1)
    return np.asarray(near[np.arange(len(places)), np.argmax(values[near], axis=1)])


def _highest_near(values: Array, reach: int) -> Array:
    """Highest value up to ``reach`` places away on either side."""
    padded = np.pad(values, reach, constant_values=-np.inf)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1))
