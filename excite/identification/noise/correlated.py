"""Noise that is correlated in time and between channels, estimated from residuals.

Filtered signals have neighbouring samples that share their noise, and wrenches moved to the base share
their force noise between channels; formulae that count every row as independent promise too much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.noise.trial_grid import TrialGrid
from excite.identification.problem import IdentificationProblem

# Lags, in independent samples of the filter, over which filtered noise is still correlated.
_FILTER_MEMORY = 8.0
_LARGEST_SHARE = 0.2
_COLUMNS_AT_ONCE = 16
_FREQUENCIES_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Stationary noise of a problem's channels.

    Attributes:
        std: ``(n_channels,)`` standard deviation of each channel [N or N·m].
        autocovariance: ``(n_lags, n_channels, n_channels)``, ``E r(t) r(t+l)ᵀ`` for ``l = 0 …`` of the
            residuals divided by ``std``, tapered.
    """

    std: Array
    autocovariance: Array

    @property
    def inflation(self) -> Array:
        """Integrated autocorrelation ``Σ ρ(l)`` of each channel, ``(n_channels,)``, at least 1.

        A constant seen through this noise is as uncertain as with so many times fewer independent rows.
        """
        diagonal = np.einsum("lcc->lc", self.autocovariance)
        return np.asarray(np.maximum(1.0, diagonal[0] + 2.0 * diagonal[1:].sum(axis=0)))

    def spectrum(self, n_fft: int) -> Array:
        """Spectral matrices of the scaled noise, ``(n_fft//2 + 1, n_channels, n_channels)``, all PSD."""
        # A trial in which a robot stands can be a single row: lags beyond it are none of its own.
        lags = self.autocovariance[: (n_fft + 1) // 2]
        padded = np.zeros((n_fft, *lags.shape[1:]))
        padded[: len(lags)] += lags.transpose(0, 2, 1)
        padded[n_fft - len(lags) + 1 :] += lags[:0:-1]
        spectrum = np.fft.rfft(padded, axis=0)
        values, vectors = np.linalg.eigh(0.5 * (spectrum + spectrum.conj().transpose(0, 2, 1)))
        return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.conj().transpose(0, 2, 1))

    def scaled(self, factor: float) -> NoiseModel:
        """The same noise with its variance multiplied by ``factor``."""
        return NoiseModel(self.std * np.sqrt(factor), self.autocovariance)


def estimate_noise(
    problem: IdentificationProblem, grids: tuple[TrialGrid, ...], residual: Array
) -> NoiseModel:
    """Estimate the autocovariance of residuals, tapered by a flat-top window, pooled over trials.

    The window (Politis and Romano 1995: one up to half its length, then falling linearly) reaches as far as
    the filter's memory and as the autocorrelation that the residuals themselves show.

    Args:
        problem: the problem whose rows the residuals belong to.
        grids: its trials' grids.
        residual: ``(n_rows,)``.
    """
    n_channels = len(problem.channel_names)
    power = np.bincount(problem.channel, residual**2, minlength=n_channels)
    std = np.sqrt(power / np.maximum(problem.numbers(), 1e-300))
    std = np.where(std > 0.0, std, 1.0)
    scaled = residual / std[problem.channel]
    shortest = min((grid.n_samples for grid in grids if grid.n_samples > 1), default=1)
    memory = int(np.ceil(_FILTER_MEMORY / min(1.0, problem.noise_bandwidth)))
    limit = max(1, min(4 * memory, int(_LARGEST_SHARE * shortest)))
    covariance = _pooled_autocovariance(problem, grids, scaled, limit + 1)
    if problem.freedom is not None:
        # What contacts tie together changes with the stance; see noise/bands.py.
        covariance = covariance * np.eye(n_channels)
    n_lags = min(limit, memory if problem.noise_bandwidth < 1.0 else 1)
    n_lags = max(n_lags, _correlation_length(covariance, sum(grid.n_samples for grid in grids)))
    lags = np.arange(min(n_lags, limit) + 1)
    window = np.clip(2.0 * (1.0 - lags / (lags[-1] + 1.0)), 0.0, 1.0)
    return NoiseModel(std, covariance[: len(lags)] * window[:, None, None])


def _pooled_autocovariance(
    problem: IdentificationProblem, grids: tuple[TrialGrid, ...], scaled: Array, n_lags: int
) -> Array:
    """``Σ r(t) r(t+l)ᵀ`` over all trials divided by the number of pairs at lag zero (so that it is PSD)."""
    n_channels = len(problem.channel_names)
    total = np.zeros((n_lags, n_channels, n_channels))
    counts = np.zeros(n_channels)
    for grid in grids:
        r = grid.spread(scaled[grid.rows], problem.channel, n_channels)
        counts += problem.numbers(grid.rows)
        n_fft = fft_length(grid.n_samples + n_lags)
        f = np.fft.rfft(r, n_fft, axis=0)
        cross = np.fft.irfft(f.conj()[:, :, None] * f[:, None, :], n_fft, axis=0)
        total += cross[:n_lags]
    scale = np.sqrt(np.maximum(counts, 1.0))
    return total / np.outer(scale, scale)


def _correlation_length(covariance: Array, n_samples: int) -> int:
    """Lag after which no channel's autocorrelation leaves the noise band, doubled for the taper."""
    diagonal = np.abs(np.einsum("lcc->lc", covariance)) / np.maximum(
        np.einsum("cc->c", covariance[0]), 1e-300
    )
    # Autocorrelations of correlated noise scatter as 1/√(independent samples), not 1/√(samples).
    independent = n_samples / max(1.0, 1.0 + 2.0 * float((diagonal[1:] ** 2).sum(axis=0).max()))
    # White noise must pass all of these looks together: the greatest of k deviates is near √(2 ln k).
    band = (np.sqrt(2.0 * np.log(diagonal.size)) + 1.0) / np.sqrt(max(independent, 1.0))
    outside = np.flatnonzero((diagonal > band).any(axis=1))
    return int(2 * outside[-1]) if len(outside) else 0


def whitened_factor(
    problem: IdentificationProblem, grids: tuple[TrialGrid, ...], columns: Array, noise: NoiseModel
) -> Array:
    """Triangular factor of the rows after the noise has been made white, ``(≤ k, k)``.

    Each trial is taken to the frequency domain and multiplied by ``S(f)^{-1/2}``; frequencies and channel
    combinations in which the noise has less than a fiftieth of its greatest power, which a filter has
    removed from both sides, are dropped. Least squares on the result is generalised least squares.

    Args:
        problem: the problem.
        grids: its trials' grids.
        columns: ``(n_rows, k)`` in the problem's units.
        noise: the noise model.
    """
    n_channels = len(problem.channel_names)
    factor = np.zeros((0, columns.shape[1]))
    for grid in grids:
        values, vectors = np.linalg.eigh(noise.spectrum(grid.n_samples))
        usable = values > 2e-2 * values.max()
        root = np.where(usable, 1.0 / np.sqrt(np.where(usable, values, 1.0)), 0.0)
        kept = np.flatnonzero(usable.any(axis=1))
        double = np.full(len(values), 2.0)
        double[0] = 1.0
        if grid.n_samples % 2 == 0:
            double[-1] = 1.0
        root = root[kept] * np.sqrt(double[kept] / grid.n_samples)[:, None]
        whiten = root[:, :, None] * vectors[kept].conj().transpose(0, 2, 1)
        transformed = _transform_columns(problem, grid, columns, noise.std, n_channels, kept)
        for start in range(0, len(kept), _FREQUENCIES_AT_ONCE):
            part = slice(start, start + _FREQUENCIES_AT_ONCE)
            z = (whiten[part] @ transformed[part]).reshape(-1, columns.shape[1])
            factor = upper_triangle(np.vstack([factor, z.real, z.imag]))
    return factor


def _transform_columns(
    problem: IdentificationProblem,
    grid: TrialGrid,
    columns: Array,
    std: Array,
    n_channels: int,
    kept: NDArray[np.int64],
) -> Array:
    """Columns of a trial over the noise's ``std`` at some frequencies, ``(n_kept, n_channels, k)``, complex."""
    scale = std[problem.channel[grid.rows], None]
    found = np.empty((len(kept), n_channels, columns.shape[1]), dtype=complex)
    for start in range(0, columns.shape[1], _COLUMNS_AT_ONCE):
        part = slice(start, start + _COLUMNS_AT_ONCE)
        spread = grid.spread(columns[grid.rows, part] / scale, problem.channel, n_channels)
        found[:, :, part] = np.fft.rfft(spread, axis=0)[kept]
    return found


def upper_triangle(rows: Array) -> Array:
    """``R`` of ``rows = Q R``: of rows ``(m, n)`` an upper triangle ``(min(m, n), n)``."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def fft_length(n: int) -> int:
    """Next product of small primes, at which the transform is fast."""
    length = n
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1
