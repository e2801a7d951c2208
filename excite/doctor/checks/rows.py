"""Rows that a logger repeated, lost or wrote out of order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.doctor.check import Check, Outcome
from excite.finding import Finding, listed
from excite.logs.log import Cleaning, Log, Trial
from excite.robot.robot import Robot


class HeldRows(Check):
    """Rows in which every measured channel repeats the row before: a logger that read the same packet twice."""

    kinds = ("repeated_rows",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        held = {trial.name: _held(trial) for trial in log.trials}
        count = {name: int(rows.sum()) for name, rows in held.items() if rows.any()}
        if not count:
            return Outcome(log)
        trials = tuple(t.rows(~held[t.name]) if t.name in count else t for t in log.trials)
        rows = sum(count.values())
        finding = Finding(
            "repeated_rows",
            f"{rows} rows repeat the row before, in {_in(count)}: the logger read the same packet twice",
            {"rows": float(rows)},
            repaired=True,
            remedy="they are left out",
            trials=tuple(count),
        )
        return Outcome(replace(log, trials=trials), (finding,))


def _held(trial: Trial) -> NDArray[np.bool_]:
    measured = [v for v in (trial.q, trial.tau, trial.current, *trial.wrenches.values()) if v is not None]
    same = np.all(np.diff(np.hstack(measured), axis=0) == 0.0, axis=1)
    moving = np.abs(np.diff(trial.q, axis=0)).max(axis=1)
    # What stands and is read without noise repeats itself by right.
    return np.concatenate([[False], same & (np.median(moving) > 0.0)])


class CountedRows(Check):
    """What the reader of the files has counted, and put right."""

    kinds = ("repeated_stamps", "reordered_rows", "missing_rows", "time_unit")

    _COUNTS: tuple[tuple[str, Callable[[Cleaning], int], str, str, str], ...] = (
        (
            "repeated_stamps",
            lambda c: c.repeated_rows,
            "rows repeat a time stamp",
            "the logger wrote a packet twice",
            "the first of each is kept",
        ),
        (
            "reordered_rows",
            lambda c: c.reordered_rows,
            "time stamps go back",
            "packets overtook each other",
            "rows were put in order",
        ),
        (
            "missing_rows",
            lambda c: c.missing_rows,
            "rows are missing",
            "packets were lost",
            "short gaps are bridged, long ones left out",
        ),
    )

    def examine(self, robot: Robot, log: Log) -> Outcome:
        found = []
        for kind, counted, what, cause, done in self._COUNTS:
            count = {trial.name: counted(trial.cleaning) for trial in log.trials if counted(trial.cleaning)}
            if count:
                rows = sum(count.values())
                text = f"{rows} {what}, in {_in(count)}: {cause}"
                found.append(
                    Finding(
                        kind, text, {"rows": float(rows)}, repaired=True, remedy=done, trials=tuple(count)
                    )
                )
        units = {trial.name: trial.cleaning.time_unit for trial in log.trials if trial.cleaning.time_unit}
        if units:
            unit = next(iter(units.values()))
            text = f"time stamps are {unit}, as rate_hz of log.yaml tells"
            found.append(
                Finding(
                    "time_unit",
                    text,
                    severity="spoils",
                    repaired=True,
                    remedy="they were taken as such; write seconds",
                    trials=tuple(units),
                )
            )
        return Outcome(log, tuple(found))


def _in(count: dict[str, int]) -> str:
    return listed([f"{name} {rows}" for name, rows in count.items()], 3)
