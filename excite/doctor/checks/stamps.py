"""Stamps that jitter: taken when samples were, or put on later."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.finding import Finding
from excite.logs.log import Log, Trial
from excite.logs.missing import missing_rows
from excite.logs.signals.clock import cubic_misfit
from excite.robot.robot import Robot

# Stamps that jitter by less than this share of a step are good enough.
_STEADY = 0.02
# An even clock is believed only where positions are clearly smoother on it: stamps are the truth by contract.
_CLEARLY = 0.95
_USUAL = 0.99


class Stamps(Check):
    """Jittered stamps are kept unless positions are clearly smoother on the even clock behind them."""

    kinds = ("late_stamps", "jitter")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        trials: list[Trial] = []
        late: dict[str, float] = {}
        jittered: dict[str, float] = {}
        for trial in log.trials:
            share, mended = _steady(trial)
            trials.append(mended)
            if share >= _STEADY:
                (jittered if mended is trial else late)[trial.name] = share
        found = []
        if late:
            text = (
                f"stamps jitter by {100 * max(late.values()):.0f} % of a step, the positions do not: they were taken "
                "when packets arrived, not when they were measured"
            )
            found.append(_finding("late_stamps", text, late, "rows were put on the even clock behind them"))
        if jittered:
            text = f"the sampling interval jitters by up to {100 * max(jittered.values()):.0f} %: no real-time priority"
            found.append(_finding("jitter", text, jittered, "the stamps are believed"))
        return Outcome(replace(log, trials=tuple(trials)) if late else log, tuple(found))


def _finding(kind: str, text: str, shares: dict[str, float], done: str) -> Finding:
    figures = {"share_of_step": max(shares.values())}
    return Finding(kind, text, figures, ("time",), repaired=True, remedy=done, trials=tuple(shares))


def _steady(trial: Trial) -> tuple[float, Trial]:
    """By which share of a step stamps jitter, and the trial on the clock that its positions believe."""
    step = np.diff(trial.time)
    missing = missing_rows(trial.time)
    jitter = float(np.std(step[missing == 0]) / np.median(step))
    if jitter < _STEADY:
        return jitter, trial
    number = np.concatenate([[0], np.cumsum(1 + missing)])
    even = np.asarray(np.polyval(np.polyfit(number, trial.time, 1), number), dtype=float)
    moving = trial.q.std(axis=0) > 0.0
    honest, late = (_roughness(clock, trial.q[:, moving]) for clock in (trial.time, even))
    return jitter, replace(trial, time=even) if late < honest + np.log(_CLEARLY) else trial


def _roughness(time: Array, q: Array) -> float:
    """Logarithm of the deviation of positions from smooth curves over a clock, mean over channels.

    Errors of the clock show in channels that move fast; those with noise or coarse steps say little of either clock.
    """
    squares = cubic_misfit(time, q) ** 2
    # Next to gaps and outliers any clock is rough.
    squares = np.minimum(squares, np.quantile(squares, _USUAL, axis=0))
    return float(0.5 * np.mean(np.log(np.maximum(squares.mean(axis=0), 1e-300))))
