"""Logs made ill: each illness by name, with the findings that may name it, weak and strong.

Written from what loggers do to data; shares no code with the doctor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from excite.logs.log import Log, Trial

Change = Callable[[Log, np.random.Generator, int], Log]


@dataclass(frozen=True)
class Illness:
    """How a log is made ill.

    Attributes:
        change: takes a log, a generator and a strength, 0 (weak) or 1 (strong).
        kind: name of the finding.
    """

    change: Change
    kind: str


def _each(log: Log, change: Callable[[Trial], Trial], **header: object) -> Log:
    return replace(
        log, trials=tuple(change(trial) for trial in log.trials), header=log.header.model_copy(update=header)
    )


def _loaded(log: Log, rng: np.random.Generator, heaviest: int) -> int:
    """One of the joints whose torque varies most; the first, whose axis mostly stands upright, left out."""
    size = np.concatenate([trial.tau for trial in log.trials]).std(axis=0)
    size[0] = 0.0
    return int(rng.choice(np.argsort(-size)[:heaviest]))


def _column(values: np.ndarray, j: int, column: np.ndarray) -> np.ndarray:
    made = np.array(values)
    made[:, j] = column
    return made


def torque_sign(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """One joint's torque turned, or all."""
    factor = np.ones(len(log.header.joints))
    if strength:
        factor[:] = -1.0
    else:
        factor[_loaded(log, rng, 4)] = -1.0
    return _each(log, lambda t: replace(t, tau=t.tau * factor))


def torques_exchanged(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Two neighbours' torques exchanged, or all in reverse order."""
    order = np.arange(len(log.header.joints))
    if strength:
        order = order[::-1].copy()
    else:
        i = int(rng.integers(0, 3))
        order[[i, i + 1]] = order[[i + 1, i]]
    return _each(log, lambda t: replace(t, tau=t.tau[:, order]))


def position_sign(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A joint's position turned: one that carries weight, or any but the first."""
    j = (1, 2)[int(rng.integers(2))] if strength else int(rng.integers(1, len(log.header.joints) - 1))

    def change(t: Trial) -> Trial:
        def turned(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else _column(values, j, -values[:, j])

        return replace(t, q=turned(t.q), v=turned(t.v), q_cmd=turned(t.q_cmd))

    return _each(log, change)


def degrees(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Positions in degrees, commands too or not."""
    return _each(
        log,
        lambda t: replace(
            t,
            q=np.degrees(t.q),
            v=None if t.v is None else np.degrees(t.v),
            q_cmd=t.q_cmd if not strength or t.q_cmd is None else np.degrees(t.q_cmd),
        ),
    )


def time_unit(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Stamps in milliseconds, or microseconds."""
    factor = (1e3, 1e6)[strength]
    return _each(log, lambda t: replace(t, time=t.time * factor))


def clock(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A clock that is a quarter slow, or 1.8 times too fast; the header says what the stamps say."""
    factor = (0.75, 1.8)[strength]
    return _each(log, lambda t: replace(t, time=t.time * factor), rate_hz=log.header.rate_hz / factor)


def torque_scale(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Torques two and a half times too large, or before a gear of 100."""
    factor = (2.5, 0.01)[strength]
    return _each(log, lambda t: replace(t, tau=t.tau * factor))


def dead_channel(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A torque that never changes."""
    j = _loaded(log, rng, 4)
    value = float(rng.normal()) if strength else 0.0
    return _each(log, lambda t: replace(t, tau=_column(t.tau, j, np.full(len(t.tau), value))))


def clipped(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A torque that reaches the sensor's range in 3 or 20 % of the rows."""
    j, share = _loaded(log, rng, 4), (0.03, 0.2)[strength]
    most = float(np.quantile(np.abs(np.concatenate([t.tau[:, j] for t in log.trials])), 1.0 - share))
    return _each(log, lambda t: replace(t, tau=_column(t.tau, j, np.clip(t.tau[:, j], -most, most))))


def quantised(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Encoders of 12 or 9 bits a turn."""
    step = 2.0 * np.pi / (2**12, 2**9)[strength]
    return _each(log, lambda t: replace(t, q=step * np.round(t.q / step)))


def missing_rows(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """One or ten rows in a hundred lost."""
    share = (0.01, 0.1)[strength]

    def change(t: Trial) -> Trial:
        keep = rng.random(len(t.time)) > share
        keep[[0, -1]] = True
        return t.rows(keep)

    return _each(log, change)


def repeated_rows(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A few rows, or one in twenty, hold what the row before them held."""

    def change(t: Trial) -> Trial:
        index = np.arange(len(t.time))
        again = rng.choice(index[1:], max(3, len(index) // 20) if strength else 4, replace=False)
        index[np.sort(again)] = np.sort(again) - 1
        return replace(t.rows(index), time=t.time)

    return _each(log, change)


def torque_late(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """Torques 60 or 200 ms late."""
    late = (0.06, 0.2)[strength]

    def change(t: Trial) -> Trial:
        moved = [np.interp(t.time - late, t.time, column) for column in t.tau.T]
        return replace(t, tau=np.column_stack(moved))

    return _each(log, change)


def zero_position(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """The zero of a joint that carries much off by 25 degrees, or a quarter turn."""
    j = _loaded(log, rng, 2)
    off = (np.radians(25.0), 0.5 * np.pi)[strength] * (1.0 if rng.random() < 0.5 else -1.0)

    def change(t: Trial) -> Trial:
        q_cmd = None if t.q_cmd is None else _column(t.q_cmd, j, t.q_cmd[:, j] + off)
        return replace(t, q=_column(t.q, j, t.q[:, j] + off), q_cmd=q_cmd)

    return _each(log, change)


def gravity(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A header that has the arm on a wall, or hanging from a ceiling, which it is not."""
    return _each(log, lambda t: t, gravity=((9.81, 0.0, 0.0), (0.0, 0.0, 9.81))[strength])


def whole_turns(log: Log, rng: np.random.Generator, strength: int) -> Log:
    """A joint that is kept within a turn whose seam lies in its travel, or that is read anew a turn away."""
    j = _loaded(log, rng, 4)

    def change(t: Trial) -> Trial:
        if strength:
            away = 2.0 * np.pi * (np.arange(len(t.time)) > len(t.time) // 2)
            return replace(t, q=_column(t.q, j, t.q[:, j] + away))
        low = np.median(t.q[:, j])
        return replace(t, q=_column(t.q, j, low + (t.q[:, j] - low) % (2.0 * np.pi)))

    return _each(log, change)


ILLNESSES: dict[str, Illness] = {
    "torque sign": Illness(torque_sign, "torque_sign"),
    "torques exchanged": Illness(torques_exchanged, "torque_order"),
    "position sign": Illness(position_sign, "position_sign"),
    "degrees": Illness(degrees, "degrees"),
    "time unit": Illness(time_unit, "time_unit"),
    "clock": Illness(clock, "clock"),
    "torque scale": Illness(torque_scale, "torque_scale"),
    "dead channel": Illness(dead_channel, "constant"),
    "clipped": Illness(clipped, "clipped"),
    "quantised": Illness(quantised, "quantised"),
    "missing rows": Illness(missing_rows, "missing_rows"),
    "repeated rows": Illness(repeated_rows, "repeated_rows"),
    "torque late": Illness(torque_late, "torque_late"),
    "zero position": Illness(zero_position, "zero_position"),
    "gravity": Illness(gravity, "gravity"),
    "whole turns": Illness(whole_turns, "whole_turns"),
}
