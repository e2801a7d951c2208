"""Clocks of a log: stamps in seconds, and gaps that no grid has to bridge at a cost that the file does not show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from excite.arrays import Array
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
