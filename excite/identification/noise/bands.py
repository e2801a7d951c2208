"""Covariance of a fit under noise of known filter and unknown power per channel and band.

All noise has passed the filter that both sides of the regression have; before it, noise of sensors is white
or nearly so. Its power is therefore estimated where it is audible, band by band, free of the bias that the
fit leaves in residuals (variance components by their expectations, MINQUE: Rao 1971).

Where contact forces were taken out, rows are ``Π n`` with a projection ``Π`` that changes with the stance: neither
their power nor what ties them is stationary, but the noise ``n`` of the torques is. As the columns lie in the range of
``Π``, ``QᵀΠ = Qᵀ``, so that ``QᵀΣQ`` needs the powers of ``n`` alone; they follow from the residuals' by counting the
``Σ Π_cc`` independent numbers of each channel in place of its rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.noise.correlated import NoiseModel, fft_length
from excite.identification.noise.spectra import (
    TransformedTrial,
    band_edges,
    band_of,
    frequency_blocks,
    spilled_power,
    transformed_trial,
    trial_bins,
)
from excite.identification.noise.trial_grid import TrialGrid
from excite.identification.problem import IdentificationProblem

_ROUNDS = 3
# A power that moves by less, as share of itself, moves no interval that anyone reads.
_SETTLED = 1e-3
# Off-diagonal powers count where they exceed chance by this many standard deviations.
_SIGNIFICANT = 4.0


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """Noise of a problem's channels before the filter.

    Attributes:
        edges: ``(n_bands + 1,)`` bounds of the bands as share of half the rate of the rows.
        power: ``(n_bands, n_channels, n_channels)`` covariance per row of the noise before the filter, of
            residuals in units of the rows' weights.
        freedom: ``(n_bands, n_channels)`` independent numbers from which each power was estimated.
        meat: ``QᵀΣQ``, ``(k, k)``.
        shares: ``(n_bands, n_channels, k)`` what each band and channel adds to the variance of each estimate.
    """

    edges: Array
    power: Array
    freedom: Array
    meat: Array
    shares: Array

    @property
    def degrees_of_freedom(self) -> Array:
        """Degrees of freedom of the variance of each estimate, ``(k,)`` (Satterthwaite 1946)."""
        total = self.shares.sum(axis=(0, 1))
        spread = (self.shares**2 / np.maximum(self.freedom, 1.0)[:, :, None]).sum(axis=(0, 1))
        return np.asarray(np.maximum(total**2 / np.maximum(spread, 1e-300), 1.0))

    def model(self, problem: IdentificationProblem, grids: tuple[TrialGrid, ...], std: Array) -> NoiseModel:
        """The same noise as autocovariances, for channels whose rows were divided by ``std``.

        The window is as long as the filter's memory and the narrowest band ask for.
        """
        narrowest = float(np.diff(self.edges).min())
        shortest = min(grid.n_samples for grid in grids)
        memory = max(8.0 / min(1.0, problem.noise_bandwidth), 4.0 / narrowest)
        n_lags = int(min(memory, max(1.0, 0.2 * shortest)))
        bins = trial_bins(problem, grids[0], fft_length(8 * n_lags + 8))
        spectrum = np.zeros((bins.n_fft // 2 + 1, *self.power.shape[1:]))
        spectrum[bins.kept] = bins.colour[:, None, None] * self.power[band_of(bins, self.edges)]
        covariance = np.fft.irfft(spectrum, bins.n_fft, axis=0)[: n_lags + 1]
        level = np.sqrt(np.maximum(np.einsum("cc->c", covariance[0]), 1e-300))
        lags = np.arange(n_lags + 1)
        window = np.clip(2.0 * (1.0 - lags / (n_lags + 1.0)), 0.0, 1.0)
        scaled = covariance / np.outer(level, level) * window[:, None, None]
        return NoiseModel(std * level, scaled)


def noise_bands(
    problem: IdentificationProblem, grids: tuple[TrialGrid, ...], q: Array, residual: Array, factor: Array
) -> NoiseBands:
    """Estimate the noise before the filter and what it does to an estimate.

    Args:
        problem: the problem.
        grids: its trials' grids.
        q: ``(n_rows, k)`` orthonormal columns ``X R⁻¹`` of the weighted rows.
        residual: ``(n_rows,)`` weighted residual of the fit.
        factor: ``R``, ``(k, k)``.
    """
    trials = tuple(transformed_trial(problem, grid, q, residual) for grid in grids)
    edges = band_edges(trials)
    moments = _Moments(trials, edges)
    tied = problem.freedom is not None
    power = moments.start()
    if tied:
        power = _own_power(power)
    meat = moments.meat(power)
    for _ in range(_ROUNDS):
        before = power
        power = moments.improved(power, meat)
        if tied:
            power = _own_power(power)
        meat = moments.meat(power)
        if _is_settled(before, power):
            break
    power = _significant_power(power, moments.freedom)
    meat = moments.meat(power)
    return NoiseBands(edges, power, moments.freedom, meat, moments.shares(power, factor))


class _Moments:
    """Expected and observed band powers of the residual."""

    def __init__(self, trials: tuple[TransformedTrial, ...], edges: Array):
        self.trials, n_bands = trials, len(edges) - 1
        n_channels = trials[0].r.shape[2]
        self.band = [band_of(trial.bins, edges) for trial in trials]
        shape = (n_bands, n_channels, n_channels)
        self.observed, self.crossed = np.zeros(shape), np.zeros(shape)
        # Expected power per unit of power of each band, the fit left aside: (bands, bands, channels, channels).
        self.spilled = np.zeros((n_bands, *shape))
        for trial, band in zip(trials, self.band, strict=True):
            bins = trial.bins
            spill = spilled_power(trial, band, n_bands)
            self.spilled += spill[:, :, None, None] * trial.counts
            for b in range(n_bands):
                for part in frequency_blocks((band == b) & bins.audible):
                    r, x = trial.r[part], trial.q[part]
                    inverse = bins.weight[part] / bins.colour[part]
                    self.observed[b] += np.einsum("f,fhc,fhd->cd", inverse, r, r)
                    self.crossed[b] += _channel_products(x * np.sqrt(bins.weight[part])[:, None, None, None])
        self.numbers = np.einsum("bbcd->bcd", self.spilled)
        taken = np.einsum("bcc->bc", self.crossed)
        self.freedom = np.maximum(np.einsum("bcc->bc", self.numbers) - taken, 1.0)

    def start(self) -> Array:
        """Powers with the fit's share of independent numbers taken away."""
        scale = np.sqrt(self.freedom[:, :, None] * self.freedom[:, None, :])
        return np.asarray(self.observed / scale)

    def meat(self, power: Array) -> Array:
        """``QᵀΣQ``."""
        k = self.trials[0].q.shape[3]
        meat = np.zeros((k, k))
        for trial, band in zip(self.trials, self.band, strict=True):
            bins = trial.bins
            for b in range(len(power)):
                root = _psd_root(power[b])
                for part in frequency_blocks(band == b):
                    size = np.sqrt(bins.weight[part] * bins.colour[part])[:, None, None, None]
                    z = (root.T @ (trial.q[part] * size)).reshape(-1, k)
                    meat += z.T @ z
        return meat

    def improved(self, power: Array, meat: Array) -> Array:
        """One step towards powers whose expected residual is the one observed.

        The residual is ``(I − QQᵀ) e``: of the noise's power in a band the fit takes twice what ``QQᵀ``
        shares with it and gives back ``Q (QᵀΣQ) Qᵀ``.
        """
        root = _psd_root(meat)
        expected = np.einsum("abcd,bcd->acd", self.spilled, power)
        given = self.crossed @ power
        expected -= given + given.transpose(0, 2, 1)
        for trial, band in zip(self.trials, self.band, strict=True):
            bins = trial.bins
            for b in range(len(power)):
                for part in frequency_blocks((band == b) & bins.audible):
                    size = np.sqrt(bins.weight[part] / bins.colour[part])[:, None, None, None]
                    expected[b] += _channel_products(_multiply_last_axis(trial.q[part], root) * size)
        own, wanted = np.einsum("bcc->bc", expected), np.einsum("bcc->bc", self.observed)
        ratio = np.sqrt(np.clip(wanted / np.maximum(own, 1e-300), 0.25, 4.0))
        stretched = power * ratio[:, :, None] * ratio[:, None, :]
        scaled = expected * ratio[:, :, None] * ratio[:, None, :]
        step = (self.observed - scaled) / np.maximum(self.numbers, 1.0)
        diagonal = np.arange(power.shape[1])
        step[:, diagonal, diagonal] = 0.0
        return np.asarray(stretched + step)

    def shares(self, power: Array, factor: Array) -> Array:
        """What each band and channel adds to the variances of ``R⁻¹Qᵀe``, ``(bands, channels, k)``."""
        inverse = np.asarray(np.linalg.solve(factor, np.eye(len(factor))), dtype=float)
        shares = np.zeros((*power.shape[:2], len(factor)))
        for trial, band in zip(self.trials, self.band, strict=True):
            bins = trial.bins
            for b in range(len(power)):
                for part in frequency_blocks(band == b):
                    x = _multiply_last_axis(trial.q[part], inverse.T)
                    weight = bins.weight[part] * bins.colour[part]
                    squared = np.einsum("f,fhck->ck", weight, np.square(x, out=x))
                    shares[b] += squared * np.diag(power[b])[:, None]
        return shares


def _is_settled(before: Array, after: Array) -> bool:
    """Whether a round has moved no power by more than a negligible share of its channels' own."""
    own = np.sqrt(np.maximum(np.einsum("bcc->bc", after), 1e-300))
    return bool((np.abs(after - before) <= _SETTLED * own[:, :, None] * own[:, None, :]).all())


def _own_power(power: Array) -> Array:
    """Each channel's own power, ``(n_bands, n_channels, n_channels)``, without what channels share."""
    return np.asarray(power * np.eye(power.shape[1]))


def _multiply_last_axis(x: Array, matrix: Array) -> Array:
    """``x @ matrix`` over the last axis as one product."""
    return (x.reshape(-1, x.shape[-1]) @ matrix).reshape(x.shape)


def _channel_products(x: Array) -> Array:
    """``Σ_f Σ_h Σ_k x[f, h, c, k] x[f, h, d, k]``, ``(n_channels, n_channels)``."""
    x = x.transpose(2, 0, 1, 3).reshape(x.shape[2], -1)
    return x @ x.T


def _significant_power(power: Array, freedom: Array) -> Array:
    """Powers between channels that do not stand out of chance removed, and all made positive."""
    own = np.sqrt(np.maximum(np.einsum("bcc->bc", power), 1e-300))
    correlation = power / (own[:, :, None] * own[:, None, :])
    numbers = np.sqrt(freedom[:, :, None] * freedom[:, None, :])
    evidence = (numbers * correlation**2).sum(axis=0)
    n_bands = len(power)
    keep = evidence > n_bands + _SIGNIFICANT * np.sqrt(2.0 * n_bands)
    np.fill_diagonal(keep, True)
    values, vectors = np.linalg.eigh(np.where(keep, power, 0.0))
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1))


def _psd_root(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
