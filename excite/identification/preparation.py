"""What is done to a trial's channels before they become rows: clock, outliers, delay, periods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.log import Trial
from excite.logs.signals.base_pose import continuous_quaternions
from excite.logs.signals.butterworth import settling_samples
from excite.logs.signals.clock import Clock, find_clock
from excite.logs.signals.resample import average_periods, replace_outliers, resample_noisy, resample_smooth
from excite.rows.saturation import flags_at
from excite.rows.settings import Filters, ProblemSettings

# From the last sample of a period to the first a joint moves no further than this many of its largest steps.
_JUMP = 3.0
_POSITIONS = ("q",)
_FORCES = ("tau", "current")
_OTHERS = ("q_cmd", "tau_cmd", "v", "a")


@dataclass(frozen=True, eq=False)
class Prepared:
    """A trial after each step that was taken.

    Attributes:
        trial: the trial, ready for filtering.
        clock: what was found of its clock; None where nobody looked.
        n_outliers: samples replaced, by channel group.
        n_periods: periods averaged; None where nothing was.
        period_std: ``(n_joints,)`` standard deviation of one torque sample about its mean period; None likewise.
    """

    trial: Trial
    clock: Clock | None = None
    n_outliers: dict[str, int] | None = None
    n_periods: int | None = None
    period_std: Array | None = None


def prepare_trial(trial: Trial, settings: ProblemSettings, filters: Filters) -> Prepared:
    """Apply what the settings ask for; with default settings the trial stays as it is.

    Args:
        trial: the trial.
        settings: clock, outliers, delay and period.
        filters: whose transients an averaged period is continued over.

    Raises:
        LogError: there is no whole period.
    """
    prepared = Prepared(trial)
    if settings.clock == "positions":
        clock = find_clock(trial.time, trial.q)
        prepared = replace(prepared, trial=replace(trial, time=clock.time), clock=clock)
    if settings.outlier_sigma is not None:
        prepared = _without_outliers(prepared, settings.outlier_sigma)
    if settings.torque_delay_s != 0.0:
        prepared = replace(prepared, trial=advance_torques(prepared.trial, settings.torque_delay_s))
    if settings.period_s is not None:
        prepared = _average_periods(prepared, settings, filters)
    return prepared


def advance_torques(trial: Trial, delay_s: float) -> Trial:
    """The trial with torques, currents and wrenches ``delay_s`` [s] earlier; ends hold their last value."""
    wanted = np.clip(trial.time + delay_s, trial.time[0], trial.time[-1])

    def shifted(values: Array) -> Array:
        return resample_noisy(trial.time, values, wanted)

    advanced = _change_channels(trial, _FORCES, shifted)
    beyond = None if trial.beyond is None else flags_at(trial.time, trial.beyond, wanted)
    return replace(advanced, beyond=beyond)


def _without_outliers(prepared: Prepared, sigma: float) -> Prepared:
    counts: dict[str, int] = {}
    trial = prepared.trial
    for group in (*_POSITIONS, *_FORCES):
        values = getattr(trial, group)
        if values is not None:
            repaired = replace_outliers(values, sigma)
            counts[group] = repaired.count
            changed: dict[str, Any] = {group: repaired.values}
            trial = replace(trial, **changed)
    wrenches = {}
    for name, values in trial.wrenches.items():
        repaired = replace_outliers(values, sigma)
        counts[f"wrench.{name}"] = repaired.count
        wrenches[name] = repaired.values
    return replace(prepared, trial=replace(trial, wrenches=wrenches), n_outliers=counts)


def _average_periods(prepared: Prepared, settings: ProblemSettings, filters: Filters) -> Prepared:
    """The mean period, continued on both sides as far as the filters' transients reach."""
    trial, period = prepared.trial, settings.period_s or 0.0
    own = 1.0 / float(np.median(np.diff(trial.time)))
    count = round(period * own)
    if count < 8:
        raise LogError(
            f"has {period * own:.1f} samples per period of {period:g} s",
            source=trial.name,
            field="period_s",
            remedy="state the period in seconds",
        )
    rate = count / period
    n = int((trial.time[-1] - trial.time[0]) * rate + 1e-6) + 1
    grid = np.minimum(trial.time[0] + np.arange(n) / rate, trial.time[-1])
    margin = (
        3 + settling_samples(rate, filters.kinematics_cutoff_hz) + settling_samples(rate, filters.cutoff_hz)
    )
    place = np.arange(-margin, count + margin)
    kept: list[tuple[int, Array]] = []

    def mean(values: Array, resample: Callable[[Array, Array, Array], Array]) -> Array:
        average = average_periods(resample(trial.time, values, grid), count, settings.skip_periods)
        kept.append((average.n_periods, np.atleast_1d(average.std)))
        return np.asarray(average.mean[place % count])

    torque = trial.tau if trial.tau is not None else trial.current
    base = trial.base
    if base is not None:
        base = mean(np.hstack([base[:, :3], continuous_quaternions(base[:, 3:])]), resample_smooth)
        base[:, 3:] /= np.linalg.norm(base[:, 3:], axis=1, keepdims=True)
    positions = _change_channels(trial, _POSITIONS, lambda values: mean(values, resample_smooth))
    _check_period(positions.q[margin : margin + count + 1], trial.name, period)
    averaged = _change_channels(positions, (*_FORCES, *_OTHERS), lambda values: mean(values, resample_noisy))
    imu = None if trial.imu is None else mean(trial.imu, resample_noisy)
    if trial.beyond is not None:
        # A mean that holds one such torque is none.
        averaged = replace(averaged, beyond=mean(trial.beyond.astype(float), resample_noisy) > 1e-9)
    nearest = np.minimum(np.searchsorted(trial.time, grid[: len(place)]), trial.n_samples - 1)
    contacts = {name: flags[nearest] for name, flags in trial.contacts.items()}
    start = trial.time[0] + (settings.skip_periods * count - margin) / rate
    averaged = replace(averaged, time=start + np.arange(len(place)) / rate, base=base)
    averaged = replace(averaged, imu=imu, contacts=contacts)
    std = None
    if torque is not None:
        average = average_periods(resample_noisy(trial.time, torque, grid), count, settings.skip_periods)
        std = np.atleast_1d(average.std)
    return replace(prepared, trial=averaged, n_periods=kept[0][0], period_std=std)


def _check_period(q: Array, trial: str, period: float) -> None:
    """Refuse a period after which the joints are not where they began: a wrong one makes torques of nothing."""
    steps = np.abs(np.diff(q, axis=0))
    largest = steps[:-1].max(axis=0)
    bad = np.flatnonzero(steps[-1] > _JUMP * largest + 1e-12)
    if len(bad):
        raise LogError(
            f"joint {bad[0]} jumps by {steps[-1][bad[0]]:.3g} rad from one period of {period:g} s to the next",
            source=trial,
            field="period_s",
            remedy="state the period of the motion, and skip_periods until it has settled",
        )


def _change_channels(trial: Trial, groups: tuple[str, ...], change: Callable[[Array], Array]) -> Trial:
    """The trial with some groups of channels changed; wrenches go with the forces."""
    values: dict[str, Any] = {}
    values |= {name: change(getattr(trial, name)) for name in groups if getattr(trial, name) is not None}
    if set(_FORCES) <= set(groups):
        values["wrenches"] = {name: change(reading) for name, reading in trial.wrenches.items()}
    return replace(trial, **values)
