"""The lag between two signals by cross-correlation, whose peak the package finds."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.identification.torque_delay import Lag, Shifted, find_peak


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

    def correlation(shift: int) -> Shifted:
        part = signal[reach + shift : len(signal) - reach + shift]
        gain = float((part * model).sum() / np.sqrt((part**2).sum() * (model**2).sum()))
        return Shifted(gain, part - model, np.gradient(model, axis=0) * rate_hz)

    return find_peak(correlation, reach, rate_hz)


def _normalised(values: Array) -> Array:
    centred = values - values.mean(axis=0)
    size = np.sqrt(np.mean(centred**2, axis=0))
    if not (size > 0.0).any():
        raise LogError("no channel varies", remedy="record a motion")
    return centred / np.where(size > 0.0, size, 1.0)
