"""Checks of the clock and of the rows: rate, time stamps, repeated rows, velocities beside positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.doubt import Doubt
from excite.finding import Finding, list_names
from excite.logs.log import Cleaning, Log, Trial
from excite.logs.quantisation import channel_noise
from excite.logs.sampling import missing_rows
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.clock import cubic_misfit
from excite.robot.robot import Robot

# The clock beside what the log says of it, and beside how fast the robot can be.

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


# Rows that repeat the row before because a logger read one packet twice, told from joints that hardly move.

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


# Rows that a logger stamped twice, lost or wrote out of order.


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


# Stamps that jitter: taken when samples were, or put on later.

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


# Logged velocities beside the slope of the positions: the clock, signs, columns.

# Velocities that a drive has filtered are a few per cent small; a clock is off by the same factor at every joint.
_CLOCK_OFF, _ALIKE = 1.06, 0.03
# Velocities are logged in these too, and no clock is off by such a factor by chance [rad/s].
_VELOCITIES_UNITS = {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0, "rev/s": 2.0 * np.pi}
# Joints whose velocity follows the slope of another factor than one.
_ODD = 2.0
_FOLLOWS = 0.9
# The step of an even clock under rows of which some were left out is that of the shortest, but for stamps that jitter;
# packets that arrive in bunches do not make a record any larger than this many rows for one.
_SHORT, _MOST_FINER = 0.05, 10


class Velocities(Check):
    """A factor that all joints share is the clock's; one joint's is a sign, a unit or another column."""

    kinds = ("clock", "velocity")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        compared = velocity_ratios(log)
        if compared is None:
            return Outcome(log)
        ratio, follows, seen = compared
        good = seen & (follows > _FOLLOWS) & (ratio > 0.0)
        if good.sum() > max(1, seen.sum() // 2):
            tick = 1.0 / float(np.median(ratio[good]))
            alike = np.abs(np.log(ratio[good] * tick)) < _ALIKE
            if alike.mean() > 0.8 and not 1.0 / _CLOCK_OFF < tick < _CLOCK_OFF and good.sum() > 1:
                unit = next((u for u, size in _VELOCITIES_UNITS.items() if _near(tick, size)), None)
                return self._clock(log, tick) if unit is None else Outcome(log, (_in_unit(unit, 1.0 / tick),))
        odd = seen & ~((ratio > 1.0 / _ODD) & (ratio < _ODD))
        if not odd.any():
            return Outcome(log)
        names = tuple(np.array(log.header.joints)[odd])
        worst = float(ratio[odd][0])
        cause = "its sign is turned" if -_ODD < worst < -1.0 / _ODD else "another joint's, or another unit"
        text = f"logged velocities of {list_names(names)} are {worst:.3g} times the slope of the positions: {cause}"
        finding = Finding(
            "velocity",
            text,
            {"ratio": worst},
            names,
            severity="note",
            remedy="velocities are taken from positions; correct the columns v.*",
        )
        return Outcome(log, (finding,))

    def _clock(self, log: Log, tick: float) -> Outcome:
        text = (
            f"all joints move {1.0 / tick:.3g} times as fast by their logged velocities as by positions and stamps: "
            f"the clock is {'fast' if tick < 1.0 else 'slow'}, or velocities are in another unit"
        )
        finding = Finding(
            "clock",
            text,
            {"tick": tick},
            ("time",),
            severity="spoils",
            repaired=True,
            remedy=f"a second of the stamps is taken as {tick:.4g} s",
        )
        trials = tuple(replace(t, time=t.time[0] + tick * (t.time - t.time[0])) for t in log.trials)
        header = log.header.model_copy(update={"rate_hz": log.header.rate_hz / tick})
        return Outcome(replace(log, header=header, trials=trials), (finding,), frozenset({Doubt.CLOCK}))


def _near(tick: float, size: float) -> bool:
    return 1.0 / _CLOCK_OFF < tick / size < _CLOCK_OFF


def _in_unit(unit: str, ratio: float) -> Finding:
    """All velocities in a unit that velocities have."""
    return Finding(
        "velocity",
        f"logged velocities are {ratio:.3g} times the slope of the positions at all joints: they look like {unit}",
        {"ratio": ratio},
        ("v",),
        severity="note",
        remedy="velocities are taken from positions; write v.* in rad/s",
    )


def _held_rows(time: Array) -> tuple[NDArray[np.intp], float]:
    """Rows on an even clock, each held until the next one was written, and that clock's step [s].

    A row that was left out repeated the one before, and so what rows say together is what they say for as long as they
    hold: a velocity that is logged as a pulse in the row in which the position moves, and as zero in those that repeat
    it, is that large for one row only.
    """
    short = float(np.quantile(np.diff(time), _SHORT))
    span = float(time[-1] - time[0])
    n = int(min(span / short, _MOST_FINER * len(time))) + 1
    clock = time[0] + span * np.arange(n) / max(n - 1, 1)
    # Half of what single precision leaves of a step: stamps that are the clock's own are not missed by rounding.
    rows = np.searchsorted(time, clock + 1e-6 * short, side="right") - 1
    return rows, span / max(n - 1, 1)


def velocity_ratios(log: Log) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Logged velocity per slope of the position, their correlation, and which joints move, each ``(n_joints,)``."""
    parts = []
    for trial in log.trials:
        rate = 1.0 / float(np.median(np.diff(trial.time)))
        cutoff = min(5.0, 0.2 * rate)
        if trial.v is None:
            continue
        rows, step = _held_rows(trial.time)
        if len(rows) <= 4 * settling_samples(1.0 / step, cutoff):
            continue
        slope = np.gradient(trial.q[rows], step, axis=0)
        parts.append([lowpass(value, 1.0 / step, cutoff) for value in (slope, trial.v[rows])])
    if not parts:
        return None
    x, v = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    power, own = (x**2).sum(axis=0), (v**2).sum(axis=0)
    seen = power > 1e-6 * max(float(power.max()), 1e-300)
    both = (x * v).sum(axis=0)
    # Errors of both sides: the slope of the line between that of one on the other and that of the other on the one.
    ratio = np.where(seen, np.sign(both) * np.sqrt(own / np.where(seen, power, 1.0)), 1.0)
    ratio = np.where(np.abs(both) > 0.1 * np.sqrt(power * own), ratio, both / np.where(seen, power, 1.0))
    return ratio, both / np.sqrt(np.maximum(power * own, 1e-300)), seen
