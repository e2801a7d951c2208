"""The log doctor: faults of the record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.diagnosis.channels import examine_channels
from excite.diagnosis.result import LogFault
from excite.logs.log import Log, Trial
from excite.robot.robot import Array, Robot


@dataclass(frozen=True, eq=False)
class Chart:
    """What the doctor found and made of it.

    Attributes:
        trials: repaired trials, in the log's order.
        faults: what was found.
        warnings: limits that remain, one sentence each.
    """

    trials: tuple[Trial, ...]
    faults: tuple[LogFault, ...]
    warnings: tuple[str, ...]


def examine(robot: Robot, log: Log) -> Chart:
    """Find and repair faults of a fixed-base log.

    Args:
        robot: the nominal model.
        log: the log.

    Returns:
        Repaired trials and the findings.
    """
    trials, faults = [], []
    for trial in log.trials:
        trial, held = _held_rows(trial)
        trial, clock = _stamps(trial, log.header.rate_hz)
        faults += [fault for fault in (held, clock) if fault is not None]
        faults += _counted(trial)
        trials.append(trial)
    mended, wrong = examine_channels(robot, log, tuple(trials))
    limits = tuple(f"{fault.what}: {fault.cause}" for fault in wrong if not fault.repaired)
    return Chart(mended, (*faults, *wrong), limits)


def _held_rows(trial: Trial) -> tuple[Trial, LogFault | None]:
    """Rows in which every measured channel repeats the row before: a logger that read the same packet twice."""
    measured = [v for v in (trial.q, trial.tau, trial.current) if v is not None]
    same = np.all(np.diff(np.hstack(measured), axis=0) == 0.0, axis=1)
    moving = np.abs(np.diff(trial.q, axis=0)).max(axis=1)
    if not same.any() or np.median(moving) == 0.0:
        return trial, None
    keep = np.concatenate([[True], ~same])
    fault = LogFault(
        kind="repeated_rows",
        where=trial.name,
        what=f"{trial.name}: {int(same.sum())} rows repeat the row before",
        cause="the logger read the same packet twice",
        repaired=True,
    )
    return trial.rows(keep), fault


def _row_numbers(time: Array, step: float) -> NDArray[np.int64]:
    """Number of each row on an even clock, from stamps that may be late by less than a step, rows missing.

    The clock's phase is the one with the fewest rows that would fall together or leave a gap.
    """
    phases = np.linspace(0.0, 1.0, 40, endpoint=False)
    numbers = [np.floor(time / step - phase).astype(np.int64) for phase in phases]
    best = numbers[int(np.argmin([np.sum(np.diff(k) != 1) for k in numbers]))]
    # A row that falls together with the next and leaves a gap behind it was later than a step.
    step_in, step_out = np.diff(best)[:-1], np.diff(best)[1:]
    best[1:-1] -= (step_in == 2) & (step_out == 0)
    return best


def _stamps(trial: Trial, rate_hz: float) -> tuple[Trial, LogFault | None]:
    """Jittered stamps: kept where positions are smoother on them than on an even grid, else evened out."""
    step = np.diff(trial.time)
    median = float(np.median(step))
    if np.std(step[step < 1.5 * median]) < 0.02 * median:
        return trial, None
    period = 1.0 / rate_hz if abs(median * rate_hz - 1.0) < 0.1 else median
    number = _row_numbers(trial.time, period)
    distinct = np.concatenate([[True], np.diff(number) > 0])
    even = np.asarray(np.polyval(np.polyfit(number, trial.time, 1), number), dtype=float)
    moving = trial.q.std(axis=0) > 0.0
    q = trial.q[distinct][:, moving]
    honest, late = (_roughness(t[distinct], q) for t in (trial.time, even))
    jitter = float(np.std(step) / median)
    if late < honest:
        fault = LogFault(
            "late_stamps",
            trial.name,
            f"{trial.name}: stamps jitter by {100 * jitter:.0f} % of a step, the positions do not",
            "stamps were taken when packets arrived, not when they were measured",
            repaired=True,
        )
        return replace(trial, time=even).rows(distinct), fault
    fault = LogFault(
        "jitter",
        trial.name,
        f"{trial.name}: the sampling interval jitters by {100 * jitter:.0f} %",
        "a logger without real-time priority",
        repaired=True,
    )
    return trial, fault


def _roughness(time: Array, q: Array) -> float:
    """Median over channels of the spread of third divided differences: noise in time shows there."""
    values = q
    for order in (1, 2, 3):
        values = np.diff(values, axis=0) / ((time[order:] - time[:-order])[:, None] / order)
    return float(np.median(np.median(np.abs(values), axis=0) / np.maximum(q.std(axis=0), 1e-12)))


def _counted(trial: Trial) -> list[LogFault]:
    """What the reader of the file has counted."""
    c, found = trial.cleaning, []
    for count, kind, what, cause in (
        (c.repeated_rows, "repeated_stamps", "rows repeat a time stamp", "the logger wrote a packet twice"),
        (c.reordered_rows, "reordered_rows", "rows stood before their time", "packets overtook each other"),
        (c.missing_rows, "missing_rows", "rows are missing", "packets were lost"),
    ):
        if count:
            found.append(LogFault(kind, trial.name, f"{trial.name}: {count} {what}", cause, repaired=True))
    for name, size in c.quantised.items():
        found.append(
            LogFault(
                "quantised",
                f"{trial.name} {name}",
                f"{name} moves in steps of {size:.3g}",
                "coarse sensor",
                False,
            )
        )
    for name, count in c.clipped.items():
        found.append(
            LogFault(
                "clipped", f"{trial.name} {name}", f"{name} is clipped in {count} rows", "sensor range", False
            )
        )
    return found
