"""The colour that a filter gives to noise, and frequencies at which the noise before it is alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.rows.settings import Filters

# Below this share of its greatest power the filter leaves too little to learn the noise from.
_AUDIBLE = 0.05
# Below this share filtered noise adds nothing to any sum.
_PRESENT = 1e-7
# A band has to hold this many independent numbers that the fit has not taken, in every channel.
_FEWEST = 12.0


def filter_power(frequency_hz: Array, filters: Filters | None, sampling_hz: float, rate_hz: float) -> Array:
    """Power of white noise after the zero-phase filter and decimation, one where nothing is filtered.

    Forwards and backwards the Butterworth amplitude is ``1/(1 + (tan πf/fs / tan πfc/fs)^2n)``; the power is
    its square, and decimation folds what lies above half the new rate.

    Args:
        frequency_hz: ``(n,)`` from 0 to half of ``rate_hz``.
        filters: the filter on both sides of the regression; None for none.
        sampling_hz: rate at which it ran.
        rate_hz: rate of the rows after decimation.

    Returns:
        ``(n,)``.
    """
    if filters is None or filters.cutoff_hz >= 0.5 * sampling_hz:
        return np.ones_like(frequency_hz)
    corner = np.tan(np.pi * filters.cutoff_hz / sampling_hz)
    power = np.zeros_like(frequency_hz)
    for fold in range(max(1, round(sampling_hz / rate_hz))):
        shifted = frequency_hz + fold * rate_hz
        # tan² has the period of the sampling rate and is even about half of it; large where it diverges.
        ratio = np.minimum(np.abs(np.tan(np.pi * shifted / sampling_hz)) / corner, 1e6)
        power += (1.0 + ratio ** (2 * filters.order)) ** -2.0
    return power


@dataclass(frozen=True, eq=False)
class Bins:
    """Frequencies of one trial's discrete transform.

    Attributes:
        n_fft: length of the transform, at least twice the trial's, so that sums over frequencies equal sums
            over all pairs of instants.
        kept: ``(n_kept,)`` indices of the frequencies at which filtered noise has power.
        relative: ``(n_kept,)`` each one's frequency as share of half the rate.
        colour: ``(n_kept,)`` power of the filtered noise there, 1 before the filter.
        audible: ``(n_kept,)`` where that is enough to learn from.
        weight: ``(n_kept,)`` one over ``n_fft``, twice that where a conjugate twin exists.
    """

    n_fft: int
    kept: NDArray[np.int64]
    relative: Array
    colour: Array
    audible: NDArray[np.bool_]
    weight: Array


def frequency_bins(n_fft: int, filters: Filters | None, sampling_hz: float, rate_hz: float) -> Bins:
    """Frequencies of a transform of length ``n_fft`` of rows at ``rate_hz``; see :class:`Bins`."""
    relative = np.arange(n_fft // 2 + 1) * 2.0 / n_fft
    colour = filter_power(0.5 * rate_hz * relative, filters, sampling_hz, rate_hz)
    kept = np.flatnonzero(colour > _PRESENT * colour.max())
    weight = np.full(len(relative), 2.0 / n_fft)
    weight[0] = 1.0 / n_fft
    if n_fft % 2 == 0:
        weight[-1] = 1.0 / n_fft
    return Bins(
        n_fft, kept, relative[kept], colour[kept], colour[kept] > _AUDIBLE * colour.max(), weight[kept]
    )


def alike_bands(power: Array, counts: Array, taken: Array) -> Array:
    """Bands of frequency in which each channel's noise is white before the filter.

    The best dyadic division by the Bayesian information criterion: a band is halved where the likelihood
    of the residual's periodogram (Whittle 1953) grows by more than chance allows. For white noise through the
    filter one band remains, and with it all that is unknown is one power per channel.

    Args:
        power: ``(2^d, n_channels)`` residual power before the filter, summed over cells of equal width.
        counts: ``(2^d, n_channels)`` independent numbers in each cell.
        taken: ``(2^d, n_channels)`` how many of them the fit has taken.

    Returns:
        First cell of each band, increasing, the first is 0.
    """
    total = max(float(counts.sum()), 2.0)
    # One power for each channel, and the place of the cut.
    price = 0.5 * (power.shape[1] + 1.0) * np.log(total)

    def cost(low: int, high: int) -> float:
        free = counts[low:high].sum(axis=0) - taken[low:high].sum(axis=0)
        seen = counts[low:high].sum(axis=0) > 0.0
        if (free[seen] < _FEWEST).any() or not seen.any():
            return np.inf
        level = np.maximum(power[low:high].sum(axis=0)[seen] / free[seen], 1e-300)
        return float(0.5 * (free[seen] * np.log(level)).sum() + price)

    def best(low: int, high: int) -> tuple[float, list[int]]:
        whole = cost(low, high)
        if high - low == 1:
            return whole, [low]
        middle = (low + high) // 2
        left, right = best(low, middle), best(middle, high)
        halves = left[0] + right[0]
        # With nothing to learn from on one side, the whole is the only choice.
        return (halves, left[1] + right[1]) if halves < whole else (whole, [low])

    return np.array(best(0, len(power))[1])
