"""Rules for the clock and the rows: rate, time stamps, repeated rows, velocities beside positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Flags
from excite.doctor.case import Case
from excite.doctor.doubt import Doubt
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.finding import list_names
from excite.logs.log import Trial
from excite.logs.quantisation import channel_noise
from excite.logs.sampling import missing_rows
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.resample import cubic_misfit

# The clock beside what the log says of it, and beside how fast the robot can be.

_SECONDS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}


def find_rate(case: Case) -> None:
    """``rate_hz`` beside the stamps; stamps in another unit where no robot is so slow."""
    _set_seconds(case)
    rate, stated = median_rate(case.log.trials), case.log.header.rate_hz
    if not is_near_one(rate / stated, THRESHOLD.rate_off):
        text = f"time stamps run at {rate:.4g} Hz, log.yaml states {stated:g} Hz: one of them is wrong"
        case.add("rate", text, {"factor": rate / stated}, ("time",))
    if rate < THRESHOLD.least_rate_hz:
        text = f"{rate:.3g} rows a second are too few for velocities and accelerations"
        case.add("low_rate", text, {"rate_hz": rate}, ("time",))


def median_rate(trials: Sequence[Trial]) -> float:
    """At which rate the stamps of most trials usually run [Hz]."""
    return float(np.median([1.0 / np.median(np.diff(trial.time)) for trial in trials]))


def _set_seconds(case: Case) -> None:
    """Take stamps of a clock at which the robot would hardly move in the unit in which it does.

    Of several units in which rows come at a rate of robots it is the one in which joints are the nearest to their
    limits of velocity: a robot may be faster than its limits say.
    """
    rate = median_rate(case.log.trials)
    units = {
        unit: seconds
        for unit, seconds in _SECONDS.items()
        if THRESHOLD.slowest_hz < rate / seconds < THRESHOLD.fastest_hz
    }
    if THRESHOLD.slowest_hz < rate < THRESHOLD.fastest_hz or not units:
        return
    limits = case.robot.limits.velocity[case.columns]
    speeds = [np.abs(np.diff(t.q, axis=0) / np.diff(t.time)[:, None]).max(axis=0) for t in case.log.trials]
    share = float(np.max(np.max(speeds, axis=0) / np.where(np.isfinite(limits), limits, 3.0)))
    unit = min(units, key=lambda name: abs(np.log(max(share, 1e-300) / units[name])))
    if share / units[unit] < THRESHOLD.slowest_share:
        return
    text = f"time stamps run at {rate:.3g} Hz, at which the robot would hardly move: they are probably {unit}"
    remedy = "they were read in that unit; write seconds, and rate_hz to match"
    case.add("time_unit", text, {"seconds": units[unit]}, ("time",), remedy=remedy)
    _scale_clock(case, units[unit], rate / units[unit], from_zero=True)


def _scale_clock(case: Case, tick: float, rate_hz: float, *, from_zero: bool = False) -> None:
    """Take a unit of the stamps as so many seconds."""

    def scaled(trial: Trial) -> Trial:
        first = trial.time[0]
        return replace(trial, time=(0.0 if from_zero else first) + tick * (trial.time - first))

    case.change_trials(scaled)
    case.change_header(rate_hz=rate_hz)


def find_held_rows(case: Case) -> None:
    """Rows in which every measured channel repeats the row before: a logger that read the same packet twice.

    A joint that stands or creeps repeats its encoder's reading by right.
    """
    held = {}
    for trial in case.log.trials:
        parts = (trial.q, trial.v, trial.a, trial.tau, trial.current, *trial.wrenches.values())
        held[trial.name] = held_rows(trial.time, np.hstack([part for part in parts if part is not None]))
    count = {name: int(rows.sum()) for name, rows in held.items() if rows.any()}
    if not count:
        return
    rows, before = sum(count.values()), median_rate(case.log.trials)
    text = (
        f"{rows} rows repeat the row before, in {_list_counts(count)}: the logger wrote the same packet twice"
    )
    case.add("repeated_rows", text, {"rows": float(rows)}, trials=tuple(count))
    case.change_trials(lambda trial: trial.rows(~held[trial.name]) if trial.name in count else trial)
    # What a log states is the rate of its rows, of which these may be so few that theirs is another.
    slower = median_rate(case.log.trials) / before
    if slower < 1.0 / THRESHOLD.rate_off:
        case.change_header(rate_hz=case.log.header.rate_hz * slower)


def held_rows(time: Array, values: Array) -> Flags:
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
    fresh, rows = np.flatnonzero(~same), np.flatnonzero(same)
    held = np.zeros(len(time), dtype=bool)
    if not same.any() or len(fresh) < THRESHOLD.fewest_fresh:
        return held
    place = np.searchsorted(fresh, rows)
    before, after = fresh[place - 1], fresh[np.minimum(place, len(fresh) - 1)]
    noise = channel_noise(time[fresh], list(values[fresh].T))
    chance = np.zeros(len(rows))
    for channel, sigma in zip(values.T, noise, strict=True):
        changes = np.abs(np.diff(channel))
        told = changes[changes > THRESHOLD.rounding * np.abs(channel).max()]
        if len(told):
            step = float(told.min())
            rate = np.abs(channel[after] - channel[before]) / np.maximum(after - before, 1) / step
            # Of what is taken for noise the rounding of readings is a part already.
            variance = 2.0 * max((sigma / step) ** 2 - 1.0 / 12.0, 0.0) + 1.0 / 6.0
            log_chance = -0.5 * (rate**2 / variance + np.log(2.0 * np.pi * variance))
            chance += np.where(rate > THRESHOLD.seen_steps, np.minimum(log_chance, 0.0), 0.0)
    held[rows] = chance < np.log(THRESHOLD.left_out_by_chance / len(time))
    return held


# Rows that a logger stamped twice, lost or wrote out of order, counted and put right by the reader of the files.

_COUNTED = (
    ("repeated_stamps", "repeated_rows", "rows repeat a time stamp", "the logger wrote a packet twice"),
    ("reordered_rows", "reordered_rows", "time stamps go back", "packets arrived out of order"),
    ("missing_rows", "missing_rows", "rows are missing", "packets were lost"),
)


def find_counted_rows(case: Case) -> None:
    """What the reader of the files has counted."""
    for kind, counted, what, cause in _COUNTED:
        count = {t.name: rows for t in case.log.trials if (rows := getattr(t.cleaning, counted))}
        if count:
            rows = sum(count.values())
            text = f"{rows} {what}, in {_list_counts(count)}: {cause}"
            case.add(kind, text, {"rows": float(rows)}, trials=tuple(count))
    units = {t.name: t.cleaning.time_unit for t in case.log.trials if t.cleaning.time_unit}
    if units:
        text = f"time stamps are {next(iter(units.values()))}, as rate_hz in log.yaml shows"
        case.add("time_unit", text, trials=tuple(units))


def _list_counts(count: dict[str, int]) -> str:
    return list_names([f"{name} {rows}" for name, rows in count.items()], 3)


# Stamps that jitter: taken when samples were, or put on later.


def find_jitter(case: Case) -> None:
    """Jittered stamps are kept unless positions are clearly smoother on the even clock behind them."""
    shares: dict[str, dict[str, float]] = {"late_stamps": {}, "jitter": {}}
    even = {}
    for trial in case.log.trials:
        share, steady = _steady_clock(trial)
        if share >= THRESHOLD.steady:
            shares["jitter" if steady is None else "late_stamps"][trial.name] = share
        if steady is not None:
            even[trial.name] = steady
    said = {
        "late_stamps": "stamps jitter by {:.0f} % of a step, the positions do not: they are the times at "
        "which packets arrived, not those of the measurement",
        "jitter": "the sampling interval jitters by up to {:.0f} %: the logger had no real-time priority",
    }
    for kind, found in shares.items():
        if found:
            most = max(found.values())
            text = said[kind].format(100 * most)
            case.add(kind, text, {"share_of_step": most}, ("time",), trials=tuple(found))
    if even:
        case.change_trials(lambda trial: replace(trial, time=even.get(trial.name, trial.time)))


def _steady_clock(trial: Trial) -> tuple[float, Array | None]:
    """By which share of a step stamps jitter, and the even clock where positions believe that."""
    step = np.diff(trial.time)
    missing = missing_rows(trial.time)
    jitter = float(np.std(step[missing == 0]) / np.median(step))
    moving = np.ptp(trial.q, axis=0) > 0.0
    if jitter < THRESHOLD.steady or not moving.any():
        return jitter, None
    number = np.concatenate([[0], np.cumsum(1 + missing)])
    even = np.asarray(np.polyval(np.polyfit(number, trial.time, 1), number), dtype=float)
    honest, late = (_roughness(clock, trial.q[:, moving]) for clock in (trial.time, even))
    return jitter, even if late < honest + np.log(THRESHOLD.clearly_smoother) else None


def _roughness(time: Array, q: Array) -> float:
    """Logarithm of the deviation of positions from smooth curves over a clock, mean over channels.

    Errors of the clock show in channels that move fast; those with noise or coarse steps say little of either clock.
    """
    squares = cubic_misfit(time, q) ** 2
    # Next to gaps and outliers any clock is rough.
    squares = np.minimum(squares, np.quantile(squares, THRESHOLD.usual_misfit, axis=0))
    return float(0.5 * np.mean(np.log(np.maximum(squares.mean(axis=0), 1e-300))))


# Logged velocities beside the slope of the positions: the clock, signs, columns.

# Units that velocities are logged in, too [rad/s]; no clock is off by such a factor by chance.
_VELOCITY_UNITS = {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0, "rev/s": 2.0 * np.pi}


def find_velocity_errors(case: Case) -> None:
    """A factor that all joints share is the clock's; one joint's is a sign, a unit or another column."""
    compared = velocity_ratios(case.log.trials)
    if compared is None:
        return
    ratio, follows = compared
    seen = np.isfinite(ratio)
    good = (follows > THRESHOLD.velocity_follows) & (ratio > 0.0)
    if good.sum() > max(1, seen.sum() // 2):
        tick = 1.0 / float(np.median(ratio[good]))
        alike = np.abs(np.log(ratio[good] * tick)) < THRESHOLD.velocities_alike
        if alike.mean() > 0.8 and not is_near_one(tick, THRESHOLD.clock_off):
            near = (u for u, size in _VELOCITY_UNITS.items() if is_near_one(tick / size, THRESHOLD.clock_off))
            _explain_common_ratio(case, tick, next(near, None))
            return
    odd = seen & ~((ratio > 1.0 / THRESHOLD.odd_velocity) & (ratio < THRESHOLD.odd_velocity))
    if odd.any():
        worst = float(ratio[odd][0])
        turned = worst < 0.0 and is_near_one(-worst, THRESHOLD.odd_velocity)
        cause = "its sign is turned" if turned else "columns of another joint, or another unit"
        names = case.joints(odd)
        text = f"logged velocities of {list_names(names)} are {worst:.3g} times the positions' derivative: {cause}"
        case.add("velocity", text, {"ratio": worst}, names)


def _explain_common_ratio(case: Case, tick: float, unit: str | None) -> None:
    """All velocities in a unit that velocities have, or else a clock that is wrong."""
    if unit is not None:
        text = (
            f"logged velocities are {1 / tick:.3g} times the positions' derivative at all joints: they are probably in "
            f"{unit}"
        )
        remedy = "velocities are computed from the positions; write v.* in rad/s"
        case.add("velocity", text, {"ratio": 1.0 / tick}, ("v",), remedy=remedy)
        return
    text = (
        f"logged velocities of all joints are {1.0 / tick:.3g} times the positions' derivatives: "
        f"the clock is {'fast' if tick < 1.0 else 'slow'}, or velocities are in another unit"
    )
    remedy = f"one second of the stamps was taken as {tick:.4g} s"
    case.add("clock", text, {"tick": tick}, ("time",), remedy=remedy)
    case.doubts.add(Doubt.CLOCK)
    _scale_clock(case, tick, case.log.header.rate_hz / tick)


def _held_grid(time: Array) -> tuple[NDArray[np.intp], float]:
    """Rows on an even clock, each held until the next one was written, and that clock's step [s].

    A row that was left out repeated the one before, and so what rows say together is what they say for as long as they
    hold: a velocity that is logged as a pulse in the row in which the position moves, and as zero in those that repeat
    it, is that large for one row only.
    """
    short = float(np.quantile(np.diff(time), THRESHOLD.shortest_steps))
    span = float(time[-1] - time[0])
    n = int(min(span / short, THRESHOLD.most_finer * len(time))) + 1
    clock = time[0] + span * np.arange(n) / max(n - 1, 1)
    # Half of what single precision leaves of a step: stamps that are the clock's own are not missed by rounding.
    rows = np.searchsorted(time, clock + 1e-6 * short, side="right") - 1
    return rows, span / max(n - 1, 1)


def velocity_ratios(trials: Sequence[Trial]) -> tuple[Array, Array] | None:
    """Logged velocity per slope of the position, NaN of joints that rest, and the correlation, ``(n_joints,)`` each."""
    parts = []
    for trial in trials:
        cutoff = min(5.0, 0.2 * median_rate([trial]))
        if trial.v is None:
            continue
        rows, step = _held_grid(trial.time)
        if len(rows) > 4 * settling_samples(1.0 / step, cutoff):
            slope = np.gradient(trial.q[rows], step, axis=0)
            parts.append([lowpass(value, 1.0 / step, cutoff) for value in (slope, trial.v[rows])])
    if not parts:
        return None
    x, v = (np.concatenate(part) for part in zip(*parts, strict=True))
    power, own, both = ((a * b).sum(axis=0) for a, b in ((x, x), (v, v), (x, v)))
    seen = power > 1e-6 * max(float(power.max()), 1e-300)
    share, size = np.where(seen, power, 1.0), np.sqrt(np.maximum(power * own, 1e-300))
    # Errors of both sides: the slope of the line between that of one on the other and that of the other on the one.
    ratio = np.where(np.abs(both) > 0.1 * size, np.sign(both) * np.sqrt(own / share), both / share)
    return np.where(seen, ratio, np.nan), both / size
