"""Rows that a logger stamped twice, lost or wrote out of order."""

from __future__ import annotations

from collections.abc import Callable

from excite.doctor.check import Check, Outcome
from excite.finding import Finding, list_names
from excite.logs.log import Cleaning, Log
from excite.robot.robot import Robot


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
    return list_names([f"{name} {rows}" for name, rows in count.items()], 3)
