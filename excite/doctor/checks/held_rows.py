"""Rows that repeat the row before because a logger read one packet twice, told from joints that hardly move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.checks.rate import RATE_OFF, rate_of
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.logs.resolution import channel_noise
from excite.robot.robot import Robot

# How many rows of a trial may be left out by chance. With a twentieth, 80 of 6.1 million rows in 1020 trials of one to
# seven joints that rest, creep or swing, read through encoders whose readings flicker by 0 to 2 steps, were left out.
# Of rows read twice in which a joint had moved by two steps, and by four times the flicker, 98 % were where one row in
# 20 was, and 90 % where one in three was.
_BY_CHANCE = 0.05
# Of a channel that changes by less than half a step a row nothing is to be seen in a single row.
_UNSEEN = 0.5
# Single precision does not part readings.
_ROUNDING = 1e-7
_FEWEST = 5


class HeldRows(Check):
    """Rows in which every measured channel repeats the row before: a logger that read the same packet twice.

    A joint that stands or creeps repeats its encoder's reading by right.
    """

    kinds = ("repeated_rows",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        held = {trial.name: _held(trial) for trial in log.trials}
        count = {name: int(rows.sum()) for name, rows in held.items() if rows.any()}
        if not count:
            return Outcome(log)
        trials = tuple(t.rows(~held[t.name]) if t.name in count else t for t in log.trials)
        rows = sum(count.values())
        where = list_names([f"{name} {number}" for name, number in count.items()], 3)
        finding = Finding(
            "repeated_rows",
            f"{rows} rows repeat the row before, in {where}: the logger read the same packet twice",
            {"rows": float(rows)},
            repaired=True,
            remedy="they are left out",
            trials=tuple(count),
        )
        # What a log states is the rate of its rows, of which these may be so few that theirs is another.
        slower, header = rate_of(trials) / rate_of(log.trials), log.header
        if slower < 1.0 / RATE_OFF:
            header = header.model_copy(update={"rate_hz": header.rate_hz * slower})
        return Outcome(replace(log, header=header, trials=trials), (finding,))


def _held(trial: Trial) -> NDArray[np.bool_]:
    parts = (trial.q, trial.v, trial.a, trial.tau, trial.current, *trial.wrenches.values())
    return held_rows(trial.time, np.hstack([part for part in parts if part is not None]))


def held_rows(time: Array, values: Array) -> NDArray[np.bool_]:
    """Rows that repeat the row before and would hardly do so had they been read anew, ``(n,)``.

    Two readings of a channel that changes by ``d`` from row to row, with noise of standard deviation ``s`` and a
    triangle of variance ``1/6`` for the rounding, all in steps of the sensor, are one with the probability
    ``N(d; 0, 2 s² + 1/6)``. How far it has changed is told by the readings before and after. Errors of the channels'
    readings are independent, so that the probabilities multiply.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].
        values: ``(n, k)`` measured channels.
    """
    same = np.concatenate([[False], np.all(np.diff(values, axis=0) == 0.0, axis=1)])
    fresh = np.flatnonzero(~same)
    if not same.any() or len(fresh) < _FEWEST:
        return np.zeros(len(time), dtype=bool)
    rows = np.flatnonzero(same)
    place = np.searchsorted(fresh, rows)
    before, after = fresh[place - 1], fresh[np.minimum(place, len(fresh) - 1)]
    noise = channel_noise(time[fresh], list(values[fresh].T))
    chance = np.zeros(len(rows))
    for channel, sigma in zip(values.T, noise, strict=True):
        changes = np.abs(np.diff(channel))
        told = changes[changes > _ROUNDING * np.abs(channel).max()]
        if not len(told):
            continue
        step = float(told.min())
        rate = np.abs(channel[after] - channel[before]) / np.maximum(after - before, 1) / step
        # Of what is taken for noise the rounding of readings is a part already.
        variance = 2.0 * max((sigma / step) ** 2 - 1.0 / 12.0, 0.0) + 1.0 / 6.0
        log_chance = -0.5 * (rate**2 / variance + np.log(2.0 * np.pi * variance))
        chance += np.where(rate > _UNSEEN, np.minimum(log_chance, 0.0), 0.0)
    held = np.zeros(len(time), dtype=bool)
    held[rows] = chance < np.log(_BY_CHANCE / len(time))
    return held
