"""Logged velocities beside the slope of the positions: the clock, signs, columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.doubt import Doubt
from excite.finding import Finding, list_names
from excite.logs.log import Log
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.robot.robot import Robot

# Velocities that a drive has filtered are a few per cent small; a clock is off by the same factor at every joint.
_CLOCK_OFF, _ALIKE = 1.06, 0.03
# Velocities are logged in these too, and no clock is off by such a factor by chance [rad/s].
_UNITS = {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0, "rev/s": 2.0 * np.pi}
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
                unit = next((u for u, size in _UNITS.items() if _near(tick, size)), None)
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
