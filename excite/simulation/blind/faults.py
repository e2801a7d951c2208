"""Faults of a record: rows repeated or lost, stamps that jitter or are late, coarse sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from excite.logs.log import Trial
from excite.robot.robot import Array


def _rows(trial: Trial, index: Array) -> Trial:
    """Some rows of a trial, in the order given."""
    take = {
        name: None if getattr(trial, name) is None else getattr(trial, name)[index]
        for name in ("q", "tau", "q_cmd", "base")
    }
    wrenches = {name: values[index] for name, values in trial.wrenches.items()}
    return replace(trial, time=trial.time[index], wrenches=wrenches, **take)


def repeated(trial: Trial, rng: np.random.Generator) -> Trial:
    """Two to four rows a trial hold what the row before them held; stamps go on."""
    index = np.arange(len(trial.time))
    again = rng.choice(index[1:], int(rng.integers(2, 5)), replace=False)
    index[again] = again - 1
    return replace(_rows(trial, index), time=trial.time)


def lost(trial: Trial, rng: np.random.Generator) -> Trial:
    """One row in fifty is missing."""
    keep = rng.random(len(trial.time)) > 0.02
    keep[[0, -1]] = True
    return _rows(trial, np.flatnonzero(keep))


def late(trial: Trial, rng: np.random.Generator) -> Trial:
    """Stamps are late by up to a third of a step; the values are not."""
    step = float(trial.time[1] - trial.time[0])
    return replace(trial, time=trial.time + rng.uniform(0.0, 0.33 * step, len(trial.time)))


def jittered(trial: Trial, rng: np.random.Generator) -> Trial:
    """Rows are taken up to a fifth of a step early or late, and their stamps say so."""
    from scipy.interpolate import CubicSpline

    step = float(trial.time[1] - trial.time[0])
    time = trial.time + rng.uniform(-0.2 * step, 0.2 * step, len(trial.time))
    time = np.clip(time, trial.time[0], trial.time[-1])
    time[0] = trial.time[0]
    order = np.argsort(time, kind="stable")
    time = time[order]

    def at(values: Array | None) -> Array | None:
        return None if values is None else np.asarray(CubicSpline(trial.time, values)(time))

    return replace(trial, time=time, q=at(trial.q), tau=at(trial.tau), q_cmd=at(trial.q_cmd))


def quantised(trial: Trial, rng: np.random.Generator) -> Trial:
    """Encoders of 16 bits a turn, torques of eight to nine bits."""
    q_step = 2.0 * np.pi / 2**16
    q = np.round(trial.q / q_step) * q_step
    if trial.tau is None:
        return replace(trial, q=q)
    step = 2.0 ** np.ceil(np.log2(trial.tau.std(axis=0) / 100.0))
    return replace(trial, q=q, tau=np.round(trial.tau / step) * step)


FAULTS: dict[str, Callable[[Trial, np.random.Generator], Trial]] = {
    "repeated_rows": repeated,
    "missing_rows": lost,
    "late_stamps": late,
    "jitter": jittered,
    "quantised": quantised,
}
