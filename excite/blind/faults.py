"""Faults of a record: rows repeated or lost, stamps that jitter or are late, coarse sensors, filters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.logs.log import Trial


def repeat_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """Two to four rows a trial hold what the row before them held; stamps go on."""
    index = np.arange(len(trial.time))
    again = rng.choice(index[1:], int(rng.integers(2, 5)), replace=False)
    index[again] = again - 1
    return replace(trial.rows(index), time=trial.time)


def lose_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """One row in fifty is missing."""
    keep = rng.random(len(trial.time)) > 0.02
    keep[[0, -1]] = True
    return trial.rows(keep)


def delay_stamps(trial: Trial, rng: np.random.Generator) -> Trial:
    """Stamps are late by up to a third of a step; the values are not."""
    step = float(trial.time[1] - trial.time[0])
    return replace(trial, time=trial.time + rng.uniform(0.0, 0.33 * step, len(trial.time)))


def jitter_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """Rows are taken up to a fifth of a step early or late, and their stamps say so."""
    from scipy.interpolate import CubicSpline

    step = float(trial.time[1] - trial.time[0])
    time = trial.time + rng.uniform(-0.2 * step, 0.2 * step, len(trial.time))
    time = np.clip(time, trial.time[0], trial.time[-1])
    time[0] = trial.time[0]
    order = np.argsort(time, kind="stable")
    time = time[order]

    def at(values: Array) -> Array:
        return np.asarray(CubicSpline(trial.time, values)(time))

    return replace(
        trial,
        time=time,
        q=at(trial.q),
        tau=None if trial.tau is None else at(trial.tau),
        q_cmd=None if trial.q_cmd is None else at(trial.q_cmd),
    )


def quantise_channels(trial: Trial, rng: np.random.Generator) -> Trial:
    """Encoders of 16 bits a turn, torques of eight to nine bits."""
    q_step = 2.0 * np.pi / 2**16
    q = np.round(trial.q / q_step) * q_step
    if trial.tau is None:
        return replace(trial, q=q)
    step = 2.0 ** np.ceil(np.log2(trial.tau.std(axis=0) / 100.0))
    return replace(trial, q=q, tau=np.round(trial.tau / step) * step)


def filter_channels(trial: Trial, rng: np.random.Generator) -> Trial:
    """All channels went through the same low-pass on their way to the log, and are late alike."""
    from scipy.signal import butter, lfilter, lfilter_zi

    rate = (len(trial.time) - 1) / float(trial.time[-1] - trial.time[0])
    b, a = butter(1, rng.uniform(30.0, 60.0), fs=rate)

    def late(values: Array) -> Array:
        start = lfilter_zi(b, a)[:, None] * values[:1]
        return np.asarray(lfilter(b, a, values, axis=0, zi=start)[0])

    return replace(
        trial,
        q=late(trial.q),
        tau=None if trial.tau is None else late(trial.tau),
        q_cmd=None if trial.q_cmd is None else late(trial.q_cmd),
    )


FAULTS: dict[str, Callable[[Trial, np.random.Generator], Trial]] = {
    "repeated_rows": repeat_rows,
    "missing_rows": lose_rows,
    "late_stamps": delay_stamps,
    "jitter": jitter_rows,
    "quantised": quantise_channels,
    "filtered": filter_channels,
}
