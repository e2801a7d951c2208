"""The log doctor: faults of the record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.result import LogFault
from excite.diagnosis.channels import examine_channels
from excite.logs.log import Log, Trial
from excite.logs.missing import missing_rows
from excite.logs.signals.clock import misfit
from excite.robot.robot import Robot

# Stamps that jitter by less than this share of a step are good enough.
_STEADY = 0.02
# An even clock is believed only where positions are clearly smoother on it: stamps are the truth by contract.
_CLEARLY = 0.95
_USUAL = 0.99


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
        trial, clock = _stamps(trial)
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


def _stamps(trial: Trial) -> tuple[Trial, LogFault | None]:
    """Jittered stamps: kept unless positions are clearly smoother on the even clock behind them."""
    step = np.diff(trial.time)
    missing = missing_rows(trial.time)
    jitter = float(np.std(step[missing == 0]) / np.median(step))
    if jitter < _STEADY:
        return trial, None
    number = np.concatenate([[0], np.cumsum(1 + missing)])
    even = np.asarray(np.polyval(np.polyfit(number, trial.time, 1), number), dtype=float)
    moving = trial.q.std(axis=0) > 0.0
    honest, late = (_roughness(clock, trial.q[:, moving]) for clock in (trial.time, even))
    if late < honest + np.log(_CLEARLY):
        fault = LogFault(
            "late_stamps",
            trial.name,
            f"{trial.name}: stamps jitter by {100 * jitter:.0f} % of a step, the positions do not",
            "stamps were taken when packets arrived, not when they were measured",
            repaired=True,
        )
        return replace(trial, time=even), fault
    fault = LogFault(
        "jitter",
        trial.name,
        f"{trial.name}: the sampling interval jitters by {100 * jitter:.0f} %",
        "a logger without real-time priority",
        repaired=True,
    )
    return trial, fault


def _roughness(time: Array, q: Array) -> float:
    """Logarithm of the deviation of positions from smooth curves over a clock, mean over channels.

    Errors of the clock show in channels that move fast; those with noise or coarse steps say little of either clock.
    """
    squares = misfit(time, q) ** 2
    # Next to gaps and outliers any clock is rough.
    squares = np.minimum(squares, np.quantile(squares, _USUAL, axis=0))
    return float(0.5 * np.mean(np.log(np.maximum(squares.mean(axis=0), 1e-300))))


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
