"""The lag between two groups of channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import LogError


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


def estimate_lag(measured: Array, predicted: Array, rate_hz: float, max_lag_s: float = 0.1) -> Lag:
    """Lag by cross-correlation: ``measured(t) ≈ predicted(t − lag)``.

    Channels count alike. The peak is found to a fraction of a sample by a parabola; the signals should be
    low-passed well below half the rate.

    Args:
        measured: ``(n, n_channels)`` uniformly sampled.
        predicted: the same of what it is compared with.
        rate_hz: their rate [Hz].
        max_lag_s: largest lag looked for [s].

    Returns:
        The lag.

    Raises:
        LogError: the signals are shorter than twice the largest lag, or do not vary.
    """
    reach = max(1, round(max_lag_s * rate_hz))
    if len(measured) <= 4 * reach:
        raise LogError(
            f"{len(measured)} samples are too few for lags of {max_lag_s:g} s", remedy="record longer"
        )
    inner = slice(reach, len(measured) - reach)
    model = _normalised(predicted)[inner]
    signal = _normalised(measured)

    def correlation(shift: int) -> tuple[float, Array, Array]:
        part = signal[reach + shift : len(signal) - reach + shift]
        gain = float((part * model).sum() / np.sqrt((part**2).sum() * (model**2).sum()))
        return gain, part - model, np.gradient(model, axis=0) * rate_hz

    return peak(correlation, reach, rate_hz)


def peak(correlation: Callable[[int], tuple[float, Array, Array]], reach: int, rate_hz: float) -> Lag:
    """The lag at which ``correlation`` is greatest.

    Args:
        correlation: for a lag in samples, the correlation, the residual ``(n, …)`` and its change with the
            lag ``(n, …)`` per second (of either sign), rows in order of time.
        reach: largest lag [samples].
        rate_hz: samples per second.
    """
    shifts = np.arange(-reach, reach + 1)
    values = np.array([correlation(int(shift))[0] for shift in shifts])
    best = int(np.argmax(values))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        left, middle, right = values[best - 1 : best + 2]
        bend = left - 2.0 * middle + right
        offset = 0.5 * float(left - right) / float(bend) if bend < 0.0 else 0.0
        top = float(middle - 0.25 * (left - right) * offset)
    else:
        top = float(values[best])
    _, residual, slope = correlation(int(shifts[best]))
    return Lag(
        lag_s=float(shifts[best] + offset) / rate_hz,
        std_s=_deviation(residual, slope),
        correlation=top,
        correlation_before=float(values[reach]),
        tried_s=shifts / rate_hz,
        correlations=values,
    )


def _normalised(values: Array) -> Array:
    centred = values - values.mean(axis=0)
    size = np.sqrt(np.mean(centred**2, axis=0))
    if not (size > 0.0).any():
        raise LogError("no channel varies", remedy="record a motion")
    return np.asarray(centred / np.where(size > 0.0, size, 1.0))


def _deviation(residual: Array, slope: Array) -> float:
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
