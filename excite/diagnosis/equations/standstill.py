"""When a joint stands: before and after a motion, and within one as far as its encoder tells; rows of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import Bands
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.own_columns import coulomb_level
from excite.diagnosis.equations.samples import ArmSamples
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import central_differences, lowpass, settling_samples
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


# Which joints stick: those of which no function of the motion explains where they are slow.

# How many times as much as elsewhere is left of a joint that sticks where it is slow, and at least what share of its
# dry friction. Of simulated arms of four makers (MuJoCo's frictionloss, made hard or as it comes, fast and slow) 60
# joints that stick have 4.1 to 49 times and 5 to 31 %, nine that turn through 1.2 to 2.4 times; a carriage on bristles
# that bend over 0.3 to 3 mm has 1.5 to 5 times and 1 to 2 %. Of ten records with six effects each (gap/many) 3, 4 and
# 6 times find the same 53, and name 4, 4 and 3 that are not there.
_WORSE, _SHARE = 4.0, 0.04
# Widths of the functions of the velocity, in speeds up to which the joint may as well stand: those of Stribeck's law,
# and what is the same in both directions.
_WIDTHS, _EVEN = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0), (0.5, 2.0, 8.0)
# Share of slow motion that the filter mixes into a row from which it is a row of that, and up to which it is not.
_SLOW, _FAST = 0.5, 0.1


def fit_where_slipping(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> Baseline:
    """The baseline, in which joints that stick are left out where they may.

    A first fit, to all of the motion, tells which joints stick; where none does it is the baseline.

    Args:
        modelled: words of ``modelled`` in ``log.yaml``.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    first = fit_baseline(samples, modelled, floor)
    sticking = samples.sticking | sticking_joints(first)
    if sticking == samples.sticking:
        return first
    return fit_baseline(replace(samples, sticking=sticking), modelled, floor)


def sticking_joints(baseline: Baseline) -> frozenset[int]:
    """Joints whose dry friction is whatever holds them where they are slow.

    Friction that follows from the motion, bristles and Stribeck's law among it, leaves of a joint's equation where the
    joint is slow what it leaves elsewhere. Friction of a joint that sticks leaves several times as much, and no
    function of the velocity takes that away. Torques that come late leave something everywhere: that goes first.

    Args:
        baseline: fitted, friction with it.
    """
    samples, use = baseline.samples, baseline.samples.identification_rows
    residual = samples.without_slip_weights(baseline.plain_residual(baseline.fit.residual))
    later = samples.to_rows([np.gradient(t.tau, t.time, axis=0) for t in samples.trials]).T
    slips, joints = samples.slipping_samples(range(len(residual))), set[int]()
    for j, mixed in enumerate(samples.to_rows(np.where(slips, 0.0, 1.0)).T):
        near, inside, outside = use & (mixed >= _FAST), mixed > _SLOW, use & (mixed < _FAST)
        if not (near & inside).any() or not outside.any():
            continue
        left = _subtract_column(residual[j], later[j], outside)
        friction = coulomb_level(baseline.modelled, baseline.fit.own_coefs[j])
        least = max(_WORSE * _root_mean_square(left[outside]), _SHARE * abs(friction))
        if _root_mean_square(left[near & inside]) < least:
            continue
        beside = left[near] - _of_velocity(samples, j, left, near)
        if _root_mean_square(beside[inside[near]]) >= least:
            joints.add(j)
    return frozenset(joints)


def _subtract_column(left: Array, column: Array, rows: NDArray[np.bool_]) -> Array:
    """What is left without as much of a column as some rows ask for, ``(n_rows,)``."""
    size = float(column[rows] @ left[rows]) / max(float(column[rows] @ column[rows]), 1e-300)
    return left - size * column


def _of_velocity(samples: ArmSamples, joint: int, left: Array, rows: NDArray[np.bool_]) -> Array:
    """What functions of a joint's velocity explain of what is left in some rows of its equation."""
    v, still = samples.motor_signal("v")[:, joint], samples.standstill[joint]
    columns = [np.sign(v) * np.exp(-np.abs(v) / (width * still)) for width in _WIDTHS]
    columns += [np.exp(-np.abs(v) / (width * still)) for width in _EVEN]
    design = samples.to_rows(np.column_stack(columns))[rows]
    return np.asarray(design @ np.linalg.lstsq(design, left[rows])[0])


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
