"""Trials in the frequency domain, and the bands in which their noise is alike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.noise.colour import Bins, alike_bands, frequency_bins
from excite.identification.noise.correlated import fft_length
from excite.identification.noise.trial_grid import TrialGrid
from excite.identification.problem import IdentificationProblem

# Cells that bands are made of, and how much is held twice at a time.
_CELLS = 256
_COLUMNS_AT_ONCE = 16
_FREQUENCIES_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class TransformedTrial:
    """One trial in the frequency domain.

    Attributes:
        bins: its frequencies.
        q: ``(n_kept, 2, n_channels, k)`` orthonormal columns, real and imaginary parts.
        r: ``(n_kept, 2, n_channels)`` residual, likewise.
        counts: ``(n_channels, n_channels)`` instants at which both channels have rows; where rows of an instant are
            tied, the independent numbers of each channel, on the diagonal alone.
        n_samples: length of the trial.
    """

    bins: Bins
    q: Array
    r: Array
    counts: Array
    n_samples: int


def trial_bins(problem: IdentificationProblem, grid: TrialGrid, n_fft: int) -> Bins:
    """The bins of a trial transformed over ``n_fft`` instants, with what the problem's filter leaves in each."""
    rate = 1.0 / grid.step_s
    return frequency_bins(n_fft, problem.filters, problem.sampling_hz or rate, rate)


def transformed_trial(
    problem: IdentificationProblem, grid: TrialGrid, q: Array, residual: Array
) -> TransformedTrial:
    """A trial's columns ``q`` ``(n_rows, k)`` and residual ``(n_rows,)`` transformed."""
    n_channels = len(problem.channel_names)
    bins = trial_bins(problem, grid, fft_length(2 * grid.n_samples))
    k = q.shape[1]
    x = np.empty((len(bins.kept), 2, n_channels, k))
    for start in range(0, k, _COLUMNS_AT_ONCE):
        part = slice(start, start + _COLUMNS_AT_ONCE)
        spread = grid.spread(q[grid.rows, part], problem.channel, n_channels)
        transformed = np.fft.rfft(spread, bins.n_fft, axis=0)[bins.kept]
        x[:, 0, :, part], x[:, 1, :, part] = transformed.real, transformed.imag
    r = grid.spread(residual[grid.rows], problem.channel, n_channels)
    mask = grid.spread(np.ones(len(grid.rows)), problem.channel, n_channels)
    counts = mask.T @ mask if problem.freedom is None else np.diag(problem.numbers(grid.rows))
    transformed = np.fft.rfft(r, bins.n_fft, axis=0)[bins.kept]
    r = np.stack([transformed.real, transformed.imag], axis=1)
    return TransformedTrial(bins, x, r, counts, grid.n_samples)


def band_edges(trials: tuple[TransformedTrial, ...]) -> Array:
    """Edges of the bands, as share of half the rate, ``(n_bands + 1,)``."""
    n_channels = trials[0].r.shape[2]
    top = max(float(trial.bins.relative[trial.bins.audible].max()) for trial in trials)
    power, counts, taken = (np.zeros((_CELLS, n_channels)) for _ in range(3))
    for trial in trials:
        bins = trial.bins
        cell = np.minimum((bins.relative / top * _CELLS).astype(np.int64), _CELLS - 1)
        use = bins.audible
        inverse = np.where(use, bins.weight / bins.colour, 0.0)
        np.add.at(power, cell, inverse[:, None] * (trial.r**2).sum(axis=1))
        np.add.at(counts, cell, np.outer(np.where(use, bins.weight, 0.0), np.diag(trial.counts)))
        absorbed = np.concatenate(
            [
                np.einsum("fhck,fhck->fc", trial.q[part], trial.q[part])
                for part in frequency_blocks(np.ones(len(bins.kept), dtype=bool))
            ]
        )
        np.add.at(taken, cell, np.where(use, bins.weight, 0.0)[:, None] * absorbed)
    first = alike_bands(power, counts, taken)
    return np.concatenate([first / _CELLS * top, [max(1.0, top)]])


def band_of(bins: Bins, edges: Array) -> NDArray[np.int64]:
    """Band of each frequency, ``(n_kept,)``."""
    return np.clip(np.searchsorted(edges, bins.relative, side="right") - 1, 0, len(edges) - 2)


def spilled_power(trial: TransformedTrial, band: NDArray[np.int64], n_bands: int) -> Array:
    """Power that noise of unit power in band b' has in the audible part of band b, per instant, ``(n_bands, n_bands)``.

    ``tr(W_b G_b')/n`` of the Toeplitz matrices of both: a record of finite length smears frequencies.

    Args:
        trial: the trial, whose bins are taken.
        band: band of each of its frequencies, ``(n_kept,)``.
        n_bands: number of bands.
    """
    bins = trial.bins
    seen, given = (np.zeros((n_bands, bins.n_fft // 2 + 1)) for _ in range(2))
    for b in range(n_bands):
        part = band == b
        given[b, bins.kept[part]] = bins.colour[part]
        part = part & bins.audible
        seen[b, bins.kept[part]] = 1.0 / bins.colour[part]
    lag = np.arange(bins.n_fft)
    pairs = np.maximum(0.0, 1.0 - np.minimum(lag, bins.n_fft - lag) / trial.n_samples)
    return np.asarray((np.fft.irfft(seen, bins.n_fft) * pairs) @ np.fft.irfft(given, bins.n_fft).T)


def frequency_blocks(chosen: NDArray[np.bool_]) -> Iterator[NDArray[np.int64]]:
    """Places of the chosen frequencies ``(n_kept,)``, a few at a time, so that columns need no second copy."""
    places = np.flatnonzero(chosen)
    for start in range(0, len(places), _FREQUENCIES_AT_ONCE):
        yield places[start : start + _FREQUENCIES_AT_ONCE]
