"""Velocities and accelerations from positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import LogError

# Central differences of sixth order: weights of the third, second and first neighbours, and of the sample itself.
_FIRST = np.array([-1.0, 9.0, -45.0]) / 60.0
_SECOND, _ITSELF = np.array([2.0, -27.0, 270.0]) / 180.0, -490.0 / 180.0


@dataclass(frozen=True, eq=False)
class Derivatives:
    """A signal and its first two derivatives, each ``(n, …)``.

    Attributes:
        value: the signal.
        first: per second.
        second: per second squared.
    """

    value: Array
    first: Array
    second: Array


def central_differences(values: Array, rate_hz: float) -> Derivatives:
    """Sixth-order central differences of a uniformly sampled signal.

    The error of the first derivative of a sine of frequency f is ``(2πf/rate)^6/140`` of its amplitude,
    that of the second ``(2πf/rate)^6/560``. The ends are continued by point reflection, so that the three
    outermost samples on either side are of low order.

    Args:
        values: ``(n, …)``, n at least 4.
        rate_hz: sampling rate [Hz].

    Returns:
        The signal and its derivatives.
    """
    before = 2.0 * values[:1] - values[3:0:-1]
    after = 2.0 * values[-1:] - values[-2:-5:-1]
    padded, n = np.concatenate([before, values, after]), len(values)
    first, second = np.zeros_like(padded[:n]), _ITSELF * values
    for k, (slope, bend) in enumerate(zip(_FIRST, _SECOND, strict=True)):
        left, right = padded[k : k + n], padded[6 - k : 6 - k + n]
        first += (left - right) * slope
        second += (left + right) * bend
    return Derivatives(values, first * rate_hz, second * rate_hz**2)


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


def wrapped_derivatives(
    values: Array, rate_hz: float, samples_per_period: int, max_frequency_hz: float
) -> Derivatives:
    """:func:`periodic_derivatives` of the middle period of a signal that repeats, continued over all of it.

    Args:
        values: ``(n, …)``, n at least ``samples_per_period`` K, repeating with it.
        rate_hz: sampling rate [Hz].
        samples_per_period: K.
        max_frequency_hz: highest frequency kept [Hz].

    Returns:
        The signal and its derivatives, ``(n, …)``.

    Raises:
        LogError: there is no whole period.
    """
    n = len(values)
    if not 0 < samples_per_period <= n:
        raise LogError(
            f"{n} samples hold no period of {samples_per_period}",
            field="period_s",
            remedy="record whole periods",
        )
    start = (n - samples_per_period) // 2
    d = periodic_derivatives(values[start : start + samples_per_period], rate_hz, max_frequency_hz)
    index = (np.arange(n) - start) % samples_per_period
    return Derivatives(d.value[index], d.first[index], d.second[index])
