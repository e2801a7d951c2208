"""Motions that repeat: the mean period, and its derivatives in the frequency domain (Xu et al., IEEE Access 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.signals.butterworth import Derivatives

# Averaging the periods of a repeated motion.


@dataclass(frozen=True, eq=False)
class PeriodAverage:
    """The mean period and the noise around it.

    Attributes:
        mean: ``(K, …)`` mean over the periods.
        std: ``(…)`` standard deviation of one sample about the mean, pooled over the period, the signal's
            unit; that of the mean itself is ``std / sqrt(n_periods)``.
        n_periods: number of periods averaged, M.
    """

    mean: Array
    std: Array
    n_periods: int


def average_periods(values: Array, samples_per_period: int, skip: int = 0) -> PeriodAverage:
    """Average the whole periods of a signal: x̄(k) = 1/M Σ x_m(k).

    (Xu et al., Dynamic identification of the KUKA LBR iiwa robot with retrieval of physical parameters
    using global optimization, IEEE Access 2020, eq. 11.) Samples after the last whole period are left out.

    Args:
        values: ``(n, …)``, uniformly sampled.
        samples_per_period: K.
        skip: periods left out at the start, while transients die down.

    Returns:
        Mean, noise, number of periods.

    Raises:
        LogError: there is no whole period.
    """
    n_periods = len(values) // samples_per_period - skip if samples_per_period > 0 else 0
    if n_periods < 1:
        raise LogError(
            f"{len(values)} samples hold no period of {samples_per_period} after {skip} skipped",
            field="samples_per_period",
            remedy="record whole periods",
        )
    start = skip * samples_per_period
    periods = values[start : start + n_periods * samples_per_period]
    periods = periods.reshape(n_periods, samples_per_period, *values.shape[1:])
    mean = periods.mean(axis=0)
    freedom = max(1, (n_periods - 1) * samples_per_period)
    std = (((periods - mean) ** 2).sum(axis=(0, 1)) / freedom) ** 0.5
    return PeriodAverage(mean=mean, std=std, n_periods=n_periods)


def periodic_derivatives(values: Array, rate_hz: float, max_frequency_hz: float) -> Derivatives:
    """Differentiate one period of a periodic signal in the frequency domain.

    Spectrum kept up to ``max_frequency_hz`` and multiplied by jω and −ω², ω(k) = 2π k f_s / K
    (Xu, Fan, Chen, Ng, Ang, Fang, Zhu, Zhao: Dynamic identification of the KUKA LBR iiwa robot with
    retrieval of physical parameters using global optimization, IEEE Access 2020, section II.C).

    Args:
        values: ``(K, …)``, exactly one period (or a whole number of them).
        rate_hz: sampling rate f_s [Hz].
        max_frequency_hz: highest frequency kept [Hz], for a Fourier motion the highest harmonic's.

    Returns:
        The signal without what lies above ``max_frequency_hz``, and its derivatives.
    """
    n = len(values)
    frequency = np.fft.rfftfreq(n, 1.0 / rate_hz)
    shape = (-1,) + (1,) * (values.ndim - 1)
    keep = (frequency <= max_frequency_hz * (1.0 + 1e-9)) & (frequency < 0.5 * rate_hz)
    omega = (2.0 * np.pi * frequency).reshape(shape)
    spectrum = np.fft.rfft(values, axis=0) * keep.reshape(shape)
    return Derivatives(
        value=np.fft.irfft(spectrum, n, axis=0),
        first=np.fft.irfft(1j * omega * spectrum, n, axis=0),
        second=np.fft.irfft(-(omega**2) * spectrum, n, axis=0),
    )
