"""Torque of a servo's integral part: its growth from the errors, its start from what the baseline misses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy

from excite.arrays import Array
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.servo import Signals


def error_integral(signals: Signals) -> Array:
    """Integral of the position error since the trial's start, ``(n, n_joints)`` [rad·s]."""
    error = signals.commanded.value - signals.measured.value
    return np.asarray(scipy.integrate.cumulative_trapezoid(error, signals.time, axis=0, initial=0.0))


@dataclass(frozen=True, eq=False)
class _Levelled(ArmSamples):
    """Samples whose filter also takes every trial's mean off: on both sides of every equation alike."""

    def rows(self, signals: Array | Sequence[Array], joints: Sequence[int] | None = None) -> Array:
        values, of_row = super().rows(signals, joints), self.trial_of_row
        parts = [values[of_row == k] for k in range(len(self.trials))]
        return np.concatenate([part - part.mean(axis=0) for part in parts])


def trial_levels(samples: ArmSamples, modelled: tuple[str, ...]) -> dict[str, Array]:
    """Constants to be added to each trial's torques, ``(n_joints,)`` [N·m] by name.

    A baseline is fitted to what varies within trials; the constants are what its torques have more than the
    trials', on the mean.

    Args:
        samples: trials with torques but for these constants.
        modelled: what the baseline has.

    Returns:
        By trial, in the order of the samples' joints.
    """
    levelled = _Levelled(**{item.name: getattr(samples, item.name) for item in fields(samples)})
    baseline = fit_baseline(levelled, modelled, spectral_floor(levelled))
    missing = [
        total - t.measured for total, t in zip(samples.split(baseline.total), samples.trials, strict=True)
    ]
    found = {}
    for trial, rest in zip(samples.trials, missing, strict=True):
        found[trial.name] = np.asarray(rest[trial.rows].mean(axis=0))
    return found
