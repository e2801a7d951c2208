"""Base parameters with intervals that hold for filtered, coloured noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.linalg import solve_triangular
from scipy.special import stdtrit

from excite.arrays import Array
from excite.identification.noise import (
    COLUMNS_AT_ONCE,
    FREQUENCIES_AT_ONCE,
    NoiseModel,
    TrialGrid,
    conjugate_counts,
    filter_amplitude,
    upper_triangle,
)
from excite.identification.problem import IdentificationProblem, row_blocks
from excite.identification.regression import RANK_TOLERANCE, Regression, leaves_freedom
from excite.regressor.base_parameters import BaseParameters, base_parameters
from excite.regressor.columns import PARAMETERS
from excite.rows.settings import Filters
from excite.threads import one_blas_thread

# Base parameters with intervals that hold for filtered noise.


@dataclass(frozen=True, eq=False)
class BaseStatistics:
    """Least-squares base parameters and their covariance.

    With ``X = QR`` the weighted base columns and ``Σ`` the covariance of the weighted noise,
    ``cov = R⁻¹ (QᵀΣQ) R⁻ᵀ``: the sandwich that is right whatever the rows' weights and correlations are. For
    white noise it is eq. (7) of Xu et al. 2020.

    Attributes:
        base: which combinations the rows determine.
        estimate: ``(n_base,)`` least-squares values [SI].
        factor: ``R``, ``(n_base, n_base)``.
        meat: ``QᵀΣQ``, ``(n_base, n_base)``, free of what the fit has taken from the residuals.
        rotated: ``Qᵀy``, ``(n_base,)``.
        noise: noise model, free of it likewise.
        white_std: ``(n_base,)`` what eq. (7) says, as if all rows were independent.
        degrees_of_freedom: ``(n_base,)`` on which each standard deviation rests.
    """

    base: BaseParameters
    estimate: Array
    factor: Array
    meat: Array
    rotated: Array
    noise: NoiseModel
    white_std: Array
    degrees_of_freedom: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance of ``estimate``, ``(n_base, n_base)``."""
        return _sandwich(self.factor, self.meat)

    @property
    def std(self) -> Array:
        """Standard deviations of ``estimate``, ``(n_base,)``."""
        return np.sqrt(np.diag(self.covariance))

    def half_width(self, level: float = 0.95) -> Array:
        """Half the width of the interval that holds the truth with probability ``level``, ``(n_base,)``.

        Student's quantile, as the noise's power is estimated from the same residuals.
        """
        return np.asarray(stdtrit(self.degrees_of_freedom, 0.5 * (1.0 + level)) * self.std)

    def rsd_percent(self, values: Array) -> Array:
        """Relative standard deviation ``100 σ/|value|``, ``(n_base,)`` [percent], infinite at zero."""
        return relative_percent(self.std, values)


@one_blas_thread
def base_statistics(rows: Regression, base: BaseParameters | None = None) -> BaseStatistics:
    """Least squares on the base parameters of weighted rows, with the covariance of correlated noise.

    Args:
        rows: the rows, weighted as the estimate to be judged was.
        base: base parameters to use, all of which the rows must determine; None takes the rows' own.

    Raises:
        InputError: the rows are zero or not finite.
    """
    problem = rows.problem
    n = problem.n_params
    if base is None:
        base = base_parameters(rows.factor[:, :n], parameter_labels(problem), RANK_TOLERANCE)
    columns = base.independent
    r = upper_triangle(rows.factor[:, [*columns, n]])
    factor, rotated = r[: base.rank, : base.rank], r[: base.rank, base.rank]
    estimate = solve_triangular(factor, rotated)
    weight = 1.0 / rows.std[problem.channel]
    q = _orthonormal(problem.Y, columns, weight, factor)
    residual = problem.y * weight - q @ (factor @ estimate)
    if rows.noise is not None and not leaves_freedom(rows):
        # The residual is none of the noise's; what the weights say of it stays.
        meat = float(rows.noise.inflation.max()) * np.eye(base.rank)
        ones = np.ones(base.rank)
        white = np.sqrt(np.diag(_sandwich(factor, np.eye(base.rank))))
        return BaseStatistics(base, estimate, factor, meat, rotated, rows.noise, white, ones)
    bands = noise_bands(problem, rows.grids, q, residual, factor)
    variance = float(residual @ residual) / max(problem.n_rows - base.rank, 1)
    return BaseStatistics(
        base=base,
        estimate=estimate,
        factor=factor,
        meat=bands.meat,
        rotated=rotated,
        noise=bands.model(problem, rows.grids, rows.std),
        white_std=np.sqrt(variance * np.diag(_sandwich(factor, np.eye(base.rank)))),
        degrees_of_freedom=bands.degrees_of_freedom,
    )


def parameter_labels(problem: IdentificationProblem) -> tuple[str, ...]:
    """Readable names of the columns, ``Izz(torso)``, ``viscous(joint1)``: those of the regressor room."""
    labels = [f"{name}({segment.name})" for segment in problem.robot.segments for name in PARAMETERS]
    drives = (name.partition(".") for name in problem.parameter_names[problem.n_inertial :])
    return (*labels, *(f"{term}({joint})" for term, _, joint in drives))


def _orthonormal(matrix: Array, columns: NDArray[np.int64], weight: Array, factor: Array) -> Array:
    """``W X R⁻¹``, ``(n_rows, n_base)``, block by block so that there is only one copy."""
    q = np.empty((len(matrix), len(columns)))
    for rows in row_blocks(len(matrix)):
        weighted = matrix[rows, columns] * weight[rows, None]
        q[rows] = solve_triangular(factor, weighted.T, trans="T", check_finite=False).T
    return q


def _sandwich(factor: Array, meat: Array) -> Array:
    inverse = solve_triangular(factor, np.eye(len(factor)))
    return np.asarray(inverse @ meat @ inverse.T)


def relative_percent(std: Array, values: Array) -> Array:
    """``100 σ/|value|`` [percent] of ``(n,)`` values, infinite where the value is zero."""
    size = np.abs(values)
    return np.where(size > 0.0, 100.0 * std / np.where(size > 0.0, size, 1.0), np.inf)


# Covariance of a fit under noise of known filter and unknown power per channel and band.
#
# All noise has passed the filter that both sides of the regression have; before it, noise of sensors is white
# or nearly so. Its power is therefore estimated where it is audible, band by band, free of the bias that the
# fit leaves in residuals (variance components by their expectations, MINQUE: Rao 1971).
#
# Where contact forces were taken out, rows are ``Π n`` with a projection ``Π`` that changes with the stance:
# neither their power nor what ties them is stationary, but the noise ``n`` of the torques is. As the columns
# lie in the range of ``Π``, ``QᵀΠ = Qᵀ``, so that ``QᵀΣQ`` needs the powers of ``n`` alone; they follow from
# the residuals' by counting the ``Σ Π_cc`` independent numbers of each channel in place of its rows.

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
        bins = trial_bins(problem, grids[0], next_fast_len(8 * n_lags + 8, real=True))
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


# The colour that a filter gives to noise, and frequencies at which the noise before it is alike.

# Below this share of its greatest power the filter leaves too little to learn the noise from.
_AUDIBLE = 0.05
# Below this share filtered noise adds nothing to any sum.
_PRESENT = 1e-7
# A band has to hold this many independent numbers that the fit has not taken, in every channel.
_FEWEST = 12.0


def filter_power(frequency_hz: Array, filters: Filters | None, sampling_hz: float, rate_hz: float) -> Array:
    """Power of white noise after the zero-phase filter and decimation, one where nothing is filtered.

    Decimation folds what lies above half the new rate.

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
    folds = rate_hz * np.arange(max(1, round(sampling_hz / rate_hz)))[:, None]
    amplitude = filter_amplitude(frequency_hz + folds, filters.cutoff_hz, filters.order, sampling_hz)
    return np.asarray((amplitude**2).sum(axis=0))


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
    weight = conjugate_counts(n_fft) / n_fft
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


# Trials in the frequency domain, and the bands in which their noise is alike.

# Cells that bands are made of.
_CELLS = 256


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
    bins = trial_bins(problem, grid, next_fast_len(2 * grid.n_samples, real=True))
    k = q.shape[1]
    x = np.empty((len(bins.kept), 2, n_channels, k))
    for start in range(0, k, COLUMNS_AT_ONCE):
        part = slice(start, start + COLUMNS_AT_ONCE)
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
    for start in range(0, len(places), FREQUENCIES_AT_ONCE):
        yield places[start : start + FREQUENCIES_AT_ONCE]
