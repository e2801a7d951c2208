"""Logs of standing robots made ill: each illness by name, with the finding that names it, weak and strong.

Written from what loggers do to data; shares no code with the doctor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from excite.logs.log import Log, Trial

Change = Callable[[Log, int], Log]


@dataclass(frozen=True)
class StandingIllness:
    """How a standing robot's log is made ill, 0 weakly or 1 strongly, and the finding that names it."""

    change: Change
    kind: str


def _each(log: Log, change: Callable[[Trial], Trial]) -> Log:
    return replace(log, trials=tuple(change(trial) for trial in log.trials))


def _wrenches(log: Log, names: tuple[str, ...], change: Callable[[np.ndarray], np.ndarray]) -> Log:
    def made(trial: Trial) -> Trial:
        said = {name: change(w) if name in names else w for name, w in trial.wrenches.items()}
        return replace(trial, wrenches=said)

    return _each(log, made)


def _names(log: Log) -> tuple[str, ...]:
    return tuple(sensor.name for sensor in log.header.sensors)


def wrench_sign(log: Log, strength: int) -> Log:
    """One sensor turned, or all."""
    names = _names(log)
    return _wrenches(log, names if strength else names[:1], lambda w: -w)


def column_sign(log: Log, strength: int) -> Log:
    """The vertical force of one sensor turned, or of all, its moments as they are."""
    names = _names(log)
    turned = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    return _wrenches(log, names if strength else names[:1], lambda w: w * turned)


def feet_exchanged(log: Log, strength: int) -> Log:
    """The first two sensors exchanged, with a sign turned besides."""
    first, second = _names(log)[:2]
    sign = -1.0 if strength else 1.0

    def made(trial: Trial) -> Trial:
        said = {**trial.wrenches, first: sign * trial.wrenches[second], second: sign * trial.wrenches[first]}
        return replace(trial, wrenches=said)

    return _each(log, made)


def axes_exchanged(log: Log, strength: int) -> Log:
    """x and y of one sensor, or the vertical under another name at all."""
    order = [2, 0, 1, 5, 3, 4] if strength else [1, 0, 2, 4, 3, 5]
    return _wrenches(log, _names(log) if strength else _names(log)[:1], lambda w: w[:, order])


def force_unit(log: Log, strength: int) -> Log:
    """Kilograms, or kilonewtons."""
    return _wrenches(log, _names(log), lambda w: w / (1e3 if strength else 9.80665))


def position_sign(log: Log, strength: int) -> Log:
    """A knee turned, or a hip's pitch."""
    word = "hip_pitch" if strength else "knee"
    j = next(k for k, name in enumerate(log.header.joints) if word in name)
    return _each(log, lambda t: replace(t, q=t.q * np.where(np.arange(t.q.shape[1]) == j, -1.0, 1.0)))


def base_quaternion(log: Log, strength: int) -> Log:
    """The inverse orientation, or the scalar first."""

    def made(trial: Trial) -> Trial:
        assert trial.base is not None
        base = np.array(trial.base)
        base[:, 3:] = trial.base[:, [6, 3, 4, 5]] if strength else trial.base[:, 3:] * [-1.0, -1.0, -1.0, 1.0]
        return replace(trial, base=base)

    return _each(log, made)


def late(log: Log, strength: int) -> Log:
    """Wrenches 150 or 300 ms late."""
    by = (0.15, 0.3)[strength]

    def made(trial: Trial) -> Trial:
        said = {
            name: np.column_stack([np.interp(trial.time - by, trial.time, column) for column in w.T])
            for name, w in trial.wrenches.items()
        }
        return replace(trial, wrenches=said)

    return _each(log, made)


def zeroed(log: Log, strength: int) -> Log:
    """Sensors zeroed while the robot stood on them: once, or before every trial."""
    once = {name: wrench[:20].mean(axis=0) for name, wrench in log.trials[0].wrenches.items()}

    def made(trial: Trial) -> Trial:
        start = (
            {name: wrench[:20].mean(axis=0) for name, wrench in trial.wrenches.items()} if strength else once
        )
        return replace(trial, wrenches={name: w - start[name] for name, w in trial.wrenches.items()})

    return _each(log, made)


STANDING_ILLNESSES: dict[str, StandingIllness] = {
    "wrench sign": StandingIllness(wrench_sign, "wrench_sign"),
    "column sign": StandingIllness(column_sign, "wrench_sign"),
    "feet exchanged": StandingIllness(feet_exchanged, "wrench_order"),
    "axes exchanged": StandingIllness(axes_exchanged, "wrench_axes"),
    "force unit": StandingIllness(force_unit, "wrench_unit"),
    "position sign": StandingIllness(position_sign, "position_sign"),
    "base quaternion": StandingIllness(base_quaternion, "base_pose"),
    "late": StandingIllness(late, "torque_late"),
    "zeroed": StandingIllness(zeroed, "zeroed_wrenches"),
}
