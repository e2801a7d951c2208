"""Zero-phase low-pass filtering of signals, and how much of white noise it leaves."""

from __future__ import annotations

import math

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.signals.sections import both_ways, butterworth_sections


def lowpass(values: Array, rate_hz: float, cutoff_hz: float, order: int = 4) -> Array:
    """Butterworth low-pass run forwards and backwards: no phase, twice the attenuation.

    The amplitude at ``cutoff_hz`` is one half (−6 dB) whatever the order; use the same call on both sides of
    a regression, so that the filter distorts neither against the other.

    Args:
        values: ``(n, …)`` uniformly sampled, filtered along the first axis.
        rate_hz: sampling rate [Hz].
        cutoff_hz: corner frequency [Hz]; at or above half the rate nothing is filtered.
        order: order of the single pass, 1 or more.

    Returns:
        Filtered values, same shape.

    Raises:
        LogError: the signal is shorter than the filter needs.
    """
    if cutoff_hz >= 0.5 * rate_hz:
        return values.copy()
    needed = settling_samples(rate_hz, cutoff_hz)
    if len(values) <= needed:
        raise LogError(
            f"{len(values)} samples are too few for a {cutoff_hz:g} Hz filter at {rate_hz:g} Hz",
            field="cutoff_hz",
            remedy=f"record at least {needed + 1} samples or raise the cut-off",
        )
    # Point reflections continue the ends with their slope.
    before, after = 2.0 * values[:1] - values[needed:0:-1], 2.0 * values[-1:] - values[-2 : -2 - needed : -1]
    padded = np.concatenate([before, values, after]).reshape(len(values) + 2 * needed, -1)
    end, rows = np.array([len(padded)]), np.arange(needed, needed + len(values))
    sections, states = butterworth_sections(order, rate_hz, cutoff_hz)
    smooth = both_ways(padded, end, rows, np.array([len(rows)]), sections, states)
    return np.ascontiguousarray(smooth).reshape(values.shape)


def settling_samples(rate_hz: float, cutoff_hz: float) -> int:
    """Samples at either end that the filter's transient reaches: two periods of the cut-off.

    The slowest pole of a fourth-order filter has died down to 8e-3 of a step there.
    """
    return 0 if cutoff_hz >= 0.5 * rate_hz else math.ceil(2.0 * rate_hz / cutoff_hz)


def noise_bandwidth(rate_hz: float, cutoff_hz: float, order: int = 4) -> float:
    """Share of white noise's power that passes :func:`lowpass`, in 0…1.

    The integral of the squared amplitude response over frequency relative to half the rate; times the rate
    it is the number of independent samples that filtered noise has in a second.
    """
    if cutoff_hz >= 0.5 * rate_hz:
        return 1.0
    n = 2048
    # The bilinear transform maps the analogue corner exactly, hence the tangents.
    corner = math.tan(math.pi * cutoff_hz / rate_hz)
    total = 0.0
    for k in range(n):
        ratio = math.tan(0.5 * math.pi * (k + 0.5) / n) / corner
        total += (1.0 / (1.0 + ratio ** (2 * order))) ** 2
    return total / n
