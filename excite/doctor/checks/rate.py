"""The clock beside what the log says of it, and beside how fast the robot can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.doctor.check import Check, Outcome
from excite.finding import Finding
from excite.logs.log import Log, Trial
from excite.robot.robot import Robot

# Rates of a log are stated with few digits; further off is another rate.
RATE_OFF = 1.05
# Rows this seldom or this often come from no logger of a robot [Hz].
_SLOWEST_HZ, _FASTEST_HZ = 2.0, 5e4
_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
# A robot that moves reaches this share of its limits of velocity, and does not pass them by more.
_SPEEDS = (1e-3, 3.0)
# A grid of accelerations needs some rows for each period of what excites a robot [Hz].
_LEAST_HZ = 20.0


class StatedRate(Check):
    """``rate_hz`` beside the stamps; stamps in another unit where no robot is so slow."""

    kinds = ("rate", "time_unit", "low_rate")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        log, found = _in_seconds(robot, log)
        rate = rate_of(log.trials)
        factor = rate / log.header.rate_hz
        if not 1.0 / RATE_OFF < factor < RATE_OFF:
            text = f"time stamps run at {rate:.4g} Hz, log.yaml says {log.header.rate_hz:g} Hz: one of them is wrong"
            found.append(
                Finding(
                    "rate",
                    text,
                    {"factor": factor},
                    ("time",),
                    severity="limits",
                    remedy="the stamps are believed; correct rate_hz, or the clock",
                )
            )
        if rate < _LEAST_HZ:
            text = f"{rate:.3g} rows a second are too few for velocities and accelerations"
            found.append(
                Finding(
                    "low_rate",
                    text,
                    {"rate_hz": rate},
                    ("time",),
                    severity="spoils",
                    remedy="log at 100 Hz or more; gravity alone can be told from standing postures",
                )
            )
        return Outcome(log, tuple(found))


def rate_of(trials: Sequence[Trial]) -> float:
    """At which rate the stamps of most trials usually run [Hz]."""
    return float(np.median([1.0 / np.median(np.diff(trial.time)) for trial in trials]))


def _in_seconds(robot: Robot, log: Log) -> tuple[Log, list[Finding]]:
    """Stamps of a clock at which the robot would hardly move, in the unit in which it does."""
    rate = rate_of(log.trials)
    if _SLOWEST_HZ < rate < _FASTEST_HZ:
        return log, []
    limits = robot.limits.velocity[[robot.joint_index(name) for name in log.header.joints]]
    speeds = [np.abs(np.diff(t.q, axis=0) / np.diff(t.time)[:, None]).max(axis=0) for t in log.trials]
    share = float(np.max(np.max(speeds, axis=0) / np.where(np.isfinite(limits), limits, 3.0)))
    for unit, seconds in _UNITS.items():
        plausible = _SPEEDS[0] < share / seconds < _SPEEDS[1]
        if plausible and _SLOWEST_HZ < rate / seconds < _FASTEST_HZ:
            text = f"time stamps run at {rate:.3g} Hz, at which the robot would hardly move: they look like {unit}"
            finding = Finding(
                "time_unit",
                text,
                {"seconds": seconds},
                ("time",),
                severity="spoils",
                repaired=True,
                remedy="they were taken as such; write seconds, and rate_hz to match",
            )
            trials = tuple(replace(t, time=seconds * (t.time - t.time[0])) for t in log.trials)
            header = log.header.model_copy(update={"rate_hz": rate / seconds})
            return replace(log, header=header, trials=trials), [finding]
    return log, []
