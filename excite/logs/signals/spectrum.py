"""Power spectra of measured signals."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array


def welch_spectrum(
    values: Array, rate_hz: float, length: int, *, median: bool = False, centred: bool = True
) -> tuple[Array, Array]:
    """One-sided power density by segments under a Hann window, half over each other (Welch 1967).

    Args:
        values: ``(n, …)``, n at least ``length``.
        rate_hz: sampling rate [Hz].
        length: samples of a segment, 2 or more.
        median: the segments' median, set right for its bias (Allen et al. 2012, FINDCHIRP, appendix B), not their
            mean: single jumps do not count.
        centred: take each segment's mean off.

    Returns:
        Frequencies ``(length // 2 + 1,)`` [Hz] and densities ``(length // 2 + 1, …)`` [values²/Hz].
    """
    hop = length - length // 2
    count = (len(values) - length // 2) // hop
    segments = values[hop * np.arange(count)[:, None] + np.arange(length)]
    if centred:
        segments = segments - segments.mean(axis=1, keepdims=True)
    window = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, length + 1))[:-1]
    window *= 1.0 / np.sqrt((window**2).sum() * rate_hz)
    spectrum = np.fft.rfft(segments * window.reshape(-1, *[1] * (values.ndim - 1)), axis=1)
    power = spectrum.real**2 + spectrum.imag**2
    power[:, 1 : (length + 1) // 2] *= 2.0
    frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    if not median:
        return frequency, np.asarray(power.mean(axis=0))
    even = 2.0 * np.arange(1, (count - 1) // 2 + 1)
    bias = 1.0 + float((1.0 / (even + 1.0) - 1.0 / even).sum())
    return frequency, np.asarray(np.median(power, axis=0) / bias)
