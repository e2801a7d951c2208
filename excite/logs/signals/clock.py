"""Whether time stamps say when samples were taken, and lags between groups of channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array


def cubic_misfit(time: Array, values: Array) -> Array:
    """Distance of each sample from the cubic through two neighbours on either side, ``(n − 4, …)``.

    Scaled so that white noise of standard deviation 1 gives 1.
    """
    n = len(time)
    centre = time[2 : n - 2]
    places = [slice(0, n - 4), slice(1, n - 3), slice(3, n - 1), slice(4, n)]
    nodes = np.stack([time[place] for place in places])
    weights = np.ones_like(nodes)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (centre - nodes[j]) / (nodes[i] - nodes[j])
    shape = (-1,) + (1,) * (values.ndim - 1)
    predicted = sum(w.reshape(shape) * values[place] for w, place in zip(weights, places, strict=True))
    scale = np.sqrt(1.0 + (weights**2).sum(axis=0)).reshape(shape)
    return np.asarray((values[2 : n - 2] - predicted) / scale)


# The lag between two groups of channels.


@dataclass(frozen=True, eq=False)
class Lag:
    """How much later one group of channels was logged than the other.

    Attributes:
        lag_s: positive where the measured one is late [s].
        std_s: its standard deviation, for correlated residuals [s].
        correlation: correlation of both, best aligned.
        correlation_before: the same as logged.
        tried_s: ``(k,)`` lags that were tried [s].
        correlations: ``(k,)`` correlation at each.
    """

    lag_s: float
    std_s: float
    correlation: float
    correlation_before: float
    tried_s: Array
    correlations: Array

    @property
    def certain(self) -> bool:
        """Whether the lag differs from zero by more than three standard deviations."""
        return abs(self.lag_s) > 3.0 * self.std_s

    def summary(self) -> str:
        """One line."""
        return (
            f"torques {1e3 * abs(self.lag_s):.2f} ± {1e3 * self.std_s:.2f} ms "
            f"{'later' if self.lag_s >= 0.0 else 'earlier'} than kinematics"
        )


@dataclass(frozen=True, eq=False)
class Shifted:
    """Two groups of channels against each other at one lag.

    Attributes:
        correlation: of both.
        residual: what is left, ``(n, …)``, rows in order of time.
        slope: its change with the lag, per second and of either sign, ``(n, …)``.
    """

    correlation: float
    residual: Array
    slope: Array


def find_peak(correlation: Callable[[int], Shifted], reach: int, rate_hz: float) -> Lag:
    """The lag at which ``correlation`` is greatest.

    Args:
        correlation: of both groups for a lag in samples.
        reach: largest lag [samples].
        rate_hz: samples per second.
    """
    shifts = np.arange(-reach, reach + 1)
    values = np.array([correlation(int(shift)).correlation for shift in shifts])
    best = int(np.argmax(values))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        left, middle, right = values[best - 1 : best + 2]
        bend = left - 2.0 * middle + right
        offset = 0.5 * float(left - right) / float(bend) if bend < 0.0 else 0.0
        top = float(middle - 0.25 * (left - right) * offset)
    else:
        top = float(values[best])
    found = correlation(int(shifts[best]))
    return Lag(
        lag_s=float(shifts[best] + offset) / rate_hz,
        std_s=_lag_deviation(found.residual, found.slope),
        correlation=top,
        correlation_before=float(values[reach]),
        tried_s=shifts / rate_hz,
        correlations=values,
    )


def _lag_deviation(residual: Array, slope: Array) -> float:
    """Sandwich: variance of ``Σ slope·residual``, neighbours in time correlated, over ``(Σ slope²)²``."""
    n = len(residual)
    score = (residual * slope).reshape(n, -1).sum(axis=1)
    information = float((slope**2).sum())
    if information == 0.0:
        return float("inf")
    spectrum = np.abs(np.fft.rfft(score, 2 * n)) ** 2
    covariances = np.fft.irfft(spectrum)[:n]
    reach = max(1, int(4.0 * (n / 100.0) ** (2.0 / 9.0)) * 4)
    taper = 1.0 - np.arange(1, reach) / reach
    variance = covariances[0] + 2.0 * float(taper @ covariances[1:reach])
    return float(np.sqrt(max(variance, covariances[0] * 1e-3)) / information)
