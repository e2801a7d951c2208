"""Samples in which a torque sensor is saturated, so that its reading is not the torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array, Flags, widen_flags
from excite.logs.log import Trial
from excite.logs.signals.butterworth import settling_samples

# Samples in which torques were beyond the range of what measured them: what stands there is not what they
# were.


def beyond_on_grid(trial: Trial, columns: Sequence[int], grid: Array, mixing: Array | None) -> Flags:
    """Which channels hold a torque that was beyond its range, ``(m, n_channels)``.

    Args:
        trial: the trial.
        columns: those of ``trial.tau`` that are the channels.
        grid: ``(m,)`` times [s]; the very array ``trial.time`` where nothing is interpolated.
        mixing: ``(n_channels, n_channels)`` what rows have of each torque, zero where they have nothing of it, as the
            matrix from joint to motor velocities says; None where each has its own alone.
    """
    if trial.beyond is None:
        return np.zeros((len(grid), len(columns)), dtype=np.bool_)
    flags = flags_at(trial.time, trial.beyond[:, list(columns)], grid)
    return flags if mixing is None else np.asarray(flags @ np.abs(mixing) > 0.0)


def flags_at(time: Array, flags: Flags, grid: Array) -> Flags:
    """Flags ``(n, k)`` at other times, ``(m, k)``: set where a sample on either side is."""
    if grid is time:
        return flags
    return np.column_stack([np.interp(grid, time, column) > 0.0 for column in flags.T.astype(float)])


def reached_samples(beyond: Flags, rate_hz: float, cutoff_hz: float) -> Flags:
    """Samples whose filtered torques hold some of those that were beyond their range, as ``beyond (n, …)``.

    As far as half of the filter's transient: what is left of a step there is less than a guess is off by.
    """
    return widen_flags(beyond, settling_samples(rate_hz, cutoff_hz) // 2)


def bridge_torques(tau: Array, nominal: Array, beyond: Flags) -> Array:
    """Torques ``(n, n_joints)``, those beyond their range by the nominal model and what it is off by on both sides.

    A filter smears what stands there into its neighbours: that is to be no more than the model is wrong by.

    Args:
        tau: measured, ``(n, n_joints)`` [N·m].
        nominal: torques of the nominal rigid bodies, likewise.
        beyond: which of ``tau`` were beyond their range, likewise.
    """
    made, at = tau.copy(), np.arange(len(tau))
    for j in np.flatnonzero(beyond.any(axis=0) & ~beyond.all(axis=0)):
        lost = beyond[:, j]
        off = tau[~lost, j] - nominal[~lost, j]
        made[lost, j] = nominal[lost, j] + np.interp(at[lost], at[~lost], off)
    return made
