"""When a joint stands: before and after a motion, and within one as far as its encoder tells; rows of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import Bands
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.differentiate import central_differences
from excite.robot.robot import Robot
from excite.rows.kinematics import in_velocities, positions_on_grid, trial_grid, trial_rate

# Bent gears and bristles remember what they did before the first sample for so long, or this share of a trial [s].
_REMEMBERED_S, _REMEMBERED = 0.5, 0.05
# Fewer rows of a trial say nothing.
_LEAST_ROWS = 20
# Speed below which a joint stands before and after a motion, and by which it surely moves within one [rad/s].
_STILL, _STANDS = 0.01, 0.012


def standstill_speed(positions: Sequence[Array], band_hz: float) -> float:
    """Speed up to which a joint may as well stand [rad/s]: no slower than its encoder tells within the band.

    Args:
        positions: of the joint as logged, one ``(n,)`` a trial [rad].
        band_hz: end of the band of the kinematics [Hz].
    """
    values = np.concatenate(positions)
    levels = np.unique(np.round(values, 9))
    coarse = 2 < len(levels) < len(values) / 3
    return max(_STANDS, 2.0 * band_hz * float(np.median(np.diff(levels)))) if coarse else _STANDS


def span_of_motion(v: Array, least: int) -> tuple[int, int]:
    """First and last sample at which a joint moves; all where that is too short a stretch.

    Args:
        v: ``(n, n_joints)`` [rad/s].
        least: samples of a stretch that is long enough.
    """
    moving = np.flatnonzero((np.abs(v) > _STILL).any(axis=1))
    if len(moving) == 0 or moving[-1] - moving[0] < least:
        return 0, len(v) - 1
    return int(moving[0]), int(moving[-1])


def rows_of_motion(v: Array, rate_hz: float, bands: Bands, name: str) -> NDArray[np.int64]:
    """Samples of a trial that make rows: of its motion, away from its ends, at the rate of the bands.

    All trials have rows at the same times after their starts: what is repeated is compared row by row.

    Args:
        v: ``(n, nv)`` [rad/s].
        rate_hz: of the samples.
        bands: frequencies.
        name: of the trial, for the error.

    Raises:
        LogError: the motion is too short.
    """
    n, edge = len(v), max(3, settling_samples(rate_hz, bands.rows_hz))
    step = max(1, round(rate_hz / bands.rate_hz))
    first, last = span_of_motion(v, 4 * edge)
    first = max(first, round(min(_REMEMBERED_S * rate_hz, _REMEMBERED * n)))
    rows = np.arange(-(-(first + edge) // step) * step, last + 1 - edge, step)
    if len(rows) < _LEAST_ROWS:
        needed = (2 * edge + _LEAST_ROWS * step) / rate_hz + _REMEMBERED_S
        raise LogError(
            f"{n / rate_hz:.2f} s with {(last - first) / rate_hz:.2f} s of motion are too short",
            source=name,
            remedy=f"leave the trial out, or record {needed:.0f} s",
        )
    return rows


def long_trials(robot: Robot, log: Log) -> tuple[Trial, ...]:
    """The trials of an arm's log whose motion is long enough for rows; all where none of a role would be left.

    A log of many motions may have one that is over before the filter has settled, and the others are no worse for it.
    """
    if len(log.trials) < 2:
        return log.trials
    rate = float(np.median([trial_rate(log.header, trial) for trial in log.trials]))
    kept = [trial for trial in log.trials if _is_long(robot, log, trial, rate)]
    if {trial.role for trial in kept} != {trial.role for trial in log.trials}:
        return log.trials
    names = {trial.name for trial in kept}
    return tuple(t if t.repeats in names else replace(t, repeats=None) for t in kept)


def _is_long(robot: Robot, log: Log, trial: Trial, rate: float) -> bool:
    bands = Bands()
    positions = positions_on_grid(trial.time, trial.q, trial_grid(trial, rate))
    slopes = central_differences(lowpass(positions, rate, bands.kinematics_hz), rate).first
    try:
        rows_of_motion(in_velocities(robot, log.header.joints, slopes), rate, bands, trial.name)
    except LogError:
        return False
    return True
