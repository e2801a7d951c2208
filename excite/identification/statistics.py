"""Base parameters with intervals that hold for filtered, coloured noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len
from scipy.linalg import solve_triangular
from scipy.special import stdtrit

from excite.arrays import Array, Flags, Indices
from excite.identification.noise import (
    COLUMNS_AT_ONCE,
    FREQUENCIES_AT_ONCE,
    NoiseModel,
    TrialGrid,
    conjugate_counts,
    filter_amplitude,
)
from excite.identification.problem import IdentificationProblem, row_blocks
from excite.identification.regression import RANK_TOLERANCE, Regression, leaves_freedom
from excite.regressor.base_parameters import BaseParameters, base_parameters, r_factor
from excite.regressor.columns import PARAMETERS
from excite.threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class BaseEstimate:
    """Base parameters and their covariance, found or predicted.

    With ``X = QR`` the weighted base columns and ``Σ`` the covariance of the weighted noise,
    ``cov = R⁻¹ (QᵀΣQ) R⁻ᵀ``: the sandwich that is right whatever the rows' weights and correlations are. For
    white noise it is eq. (7) of Xu et al. 2020.

    Attributes:
        base: which combinations the rows determine.
        estimate: ``(n_base,)`` their values [SI].
        factor: ``R``, ``(n_base, n_base)``.
        meat: ``QᵀΣQ``, ``(n_base, n_base)``.
        rotated: ``Qᵀy``, ``(n_base,)``.
    """

    base: BaseParameters
    estimate: Array
    factor: Array
    meat: Array
    rotated: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance of ``estimate``, ``(n_base, n_base)``."""
        return _sandwich_covariance(self.factor, self.meat)

    @property
    def std(self) -> Array:
        """Standard deviations of ``estimate``, ``(n_base,)``."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class BaseStatistics(BaseEstimate):
    """Least-squares base parameters; their noise is free of what the fit has taken from the residuals.

    Attributes:
        noise: noise model.
        white_std: ``(n_base,)`` what eq. (7) says, as if all rows were independent.
        degrees_of_freedom: ``(n_base,)`` on which each standard deviation rests.
    """

    noise: NoiseModel
    white_std: Array
    degrees_of_freedom: Array

    def half_width(self) -> Array:
        """Half the width of the 95 % intervals, ``(n_base,)``.

        Student's quantile, as the noise's power is estimated from the same residuals.
        """
        return np.asarray(stdtrit(self.degrees_of_freedom, 0.975) * self.std)


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
    r = r_factor(rows.factor[:, [*columns, n]])
    factor, rotated = r[: base.rank, : base.rank], r[: base.rank, base.rank]
    estimate = solve_triangular(factor, rotated)
    weight = 1.0 / rows.std[problem.channel]
    q = _orthonormal_columns(problem.Y, columns, weight, factor)
    residual = problem.y * weight - q @ (factor @ estimate)
    if rows.noise is not None and not leaves_freedom(rows):
        # The residual is none of the noise's; what the weights say of it stays.
        meat = float(rows.noise.inflation.max()) * np.eye(base.rank)
        ones = np.ones(base.rank)
        white = np.sqrt(np.diag(_sandwich_covariance(factor, np.eye(base.rank))))
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
        white_std=np.sqrt(variance * np.diag(_sandwich_covariance(factor, np.eye(base.rank)))),
        degrees_of_freedom=bands.degrees_of_freedom,
    )


def parameter_labels(problem: IdentificationProblem) -> tuple[str, ...]:
    """Readable names of the columns, ``Izz(torso)``, ``viscous(joint1)``: those of the regressor room."""
    labels = [f"{name}({segment.name})" for segment in problem.robot.segments for name in PARAMETERS]
    drives = (name.partition(".") for name in problem.parameter_names[problem.n_inertial :])
    return (*labels, *(f"{term}({joint})" for term, _, joint in drives))


def _orthonormal_columns(matrix: Array, columns: Indices, weight: Array, factor: Array) -> Array:
    """``W X R⁻¹``, ``(n_rows, n_base)``, block by block so that there is only one copy."""
    q = np.empty((len(matrix), len(columns)))
    for rows in row_blocks(len(matrix)):
        weighted = matrix[rows, columns] * weight[rows, None]
        q[rows] = solve_triangular(factor, weighted.T, trans="T", check_finite=False).T
    return q


def _sandwich_covariance(factor: Array, meat: Array) -> Array:
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
_TINY = 1e-300


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
        return np.asarray(np.maximum(total**2 / np.maximum(spread, _TINY), 1.0))

    def model(self, problem: IdentificationProblem, grids: tuple[TrialGrid, ...], std: Array) -> NoiseModel:
        """The same noise as autocovariances, for channels whose rows were divided by ``std``.

        The window is as long as the filter's memory and the narrowest band ask for.
        """
        shortest = min(grid.n_samples for grid in grids)
        memory = max(8.0 / min(1.0, problem.noise_bandwidth), 4.0 / float(np.diff(self.edges).min()))
        n_lags = int(min(memory, max(1.0, 0.2 * shortest)))
        bins = trial_bins(problem, grids[0], next_fast_len(8 * n_lags + 8, real=True))
        spectrum = np.zeros((bins.n_fft // 2 + 1, *self.power.shape[1:]))
        spectrum[bins.kept] = bins.colour[:, None, None] * self.power[bins.band(self.edges)]
        covariance = np.fft.irfft(spectrum, bins.n_fft, axis=0)[: n_lags + 1]
        level = np.sqrt(np.maximum(np.diag(covariance[0]), _TINY))
        window = np.clip(2.0 * (1.0 - np.arange(n_lags + 1) / (n_lags + 1.0)), 0.0, 1.0)
        return NoiseModel(std * level, covariance / np.outer(level, level) * window[:, None, None])


def noise_bands(
    problem: IdentificationProblem, grids: tuple[TrialGrid, ...], q: Array, residual: Array, factor: Array
) -> NoiseBands:
    """Estimate the noise before the filter and what it does to an estimate.

    Args:
        q: ``(n_rows, k)`` orthonormal columns ``X R⁻¹`` of the weighted rows.
        residual: ``(n_rows,)`` weighted residual of the fit.
        factor: ``R``, ``(k, k)``.
    """
    trials = tuple(transformed_trial(problem, grid, q, residual) for grid in grids)
    edges = band_edges(trials)
    moments = _Moments(trials, edges)
    # Where contacts tie the rows of an instant, channels share nothing that is stationary.
    shared = np.ones_like(moments.observed) if problem.freedom is None else np.eye(moments.observed.shape[1])
    power = moments.start() * shared
    meat = moments.meat(power)
    for _ in range(_ROUNDS):
        before, power = power, moments.improve_power(power, meat) * shared
        meat = moments.meat(power)
        if (np.abs(power - before) <= _SETTLED * _own_size(power)).all():
            break
    # Powers between channels that do not stand out of chance removed, and all made positive.
    numbers = np.sqrt(moments.freedom[:, :, None] * moments.freedom[:, None, :])
    evidence = (numbers * (power / _own_size(power)) ** 2).sum(axis=0)
    keep = evidence > len(power) + _SIGNIFICANT * np.sqrt(2.0 * len(power))
    np.fill_diagonal(keep, True)
    root = _psd_root(np.where(keep, power, 0.0))
    power = np.asarray(root @ root.transpose(0, 2, 1))
    return NoiseBands(edges, power, moments.freedom, moments.meat(power), moments.shares(power, factor))


class _Moments:
    """Expected and observed band powers of the residual."""

    def __init__(self, trials: tuple[TransformedTrial, ...], edges: Array):
        self.trials, self.n_bands = trials, len(edges) - 1
        self.band = [trial.bins.band(edges) for trial in trials]
        shape = (self.n_bands, *trials[0].counts.shape)
        self.observed, self.crossed = np.zeros(shape), np.zeros(shape)
        # Expected power per unit of power of each band, the fit left aside: (bands, bands, channels, channels).
        self.spilled = sum(
            spilled_power(trial, band, self.n_bands)[:, :, None, None] * trial.counts
            for trial, band in zip(trials, self.band, strict=True)
        )
        for b, trial, part in self._iterate_parts(audible=True):
            inverse = trial.bins.weight[part] / trial.bins.colour[part]
            self.observed[b] += np.einsum("f,fhc,fhd->cd", inverse, trial.r[part], trial.r[part])
            self.crossed[b] += _channel_products(_scale_columns(trial.q[part], trial.bins.weight[part]))
        self.numbers = np.einsum("bbcd->bcd", self.spilled)
        self.freedom = np.maximum(np.einsum("bcc->bc", self.numbers - self.crossed), 1.0)

    def _iterate_parts(self, *, audible: bool = False) -> Iterator[tuple[int, TransformedTrial, Indices]]:
        """Band, trial, and places of some of its frequencies there: all, or those to learn from."""
        for trial, band in zip(self.trials, self.band, strict=True):
            for b in range(self.n_bands):
                chosen = (band == b) & trial.bins.audible if audible else band == b
                for part in frequency_blocks(chosen):
                    yield b, trial, part

    def start(self) -> Array:
        """Powers with the fit's share of independent numbers taken away."""
        scale = np.sqrt(self.freedom[:, :, None] * self.freedom[:, None, :])
        return np.asarray(self.observed / scale)

    def meat(self, power: Array) -> Array:
        """``QᵀΣQ``."""
        k = self.trials[0].q.shape[3]
        meat, roots = np.zeros((k, k)), [_psd_root(one) for one in power]
        for b, trial, part in self._iterate_parts():
            weight = trial.bins.weight[part] * trial.bins.colour[part]
            z = (roots[b].T @ _scale_columns(trial.q[part], weight)).reshape(-1, k)
            meat += z.T @ z
        return meat

    def improve_power(self, power: Array, meat: Array) -> Array:
        """One step towards powers whose expected residual is the one observed.

        The residual is ``(I − QQᵀ) e``: of the noise's power in a band the fit takes twice what ``QQᵀ``
        shares with it and gives back ``Q (QᵀΣQ) Qᵀ``.
        """
        root = _psd_root(meat)
        expected = np.einsum("abcd,bcd->acd", self.spilled, power)
        given = self.crossed @ power
        expected -= given + given.transpose(0, 2, 1)
        for b, trial, part in self._iterate_parts(audible=True):
            weight = trial.bins.weight[part] / trial.bins.colour[part]
            expected[b] += _channel_products(_scale_columns(_multiply_last_axis(trial.q[part], root), weight))
        own, wanted = np.einsum("bcc->bc", expected), np.einsum("bcc->bc", self.observed)
        ratio = np.sqrt(np.clip(wanted / np.maximum(own, _TINY), 0.25, 4.0))
        both = ratio[:, :, None] * ratio[:, None, :]
        step = (self.observed - expected * both) / np.maximum(self.numbers, 1.0)
        return np.asarray(power * both + step * (1.0 - np.eye(power.shape[1])))

    def shares(self, power: Array, factor: Array) -> Array:
        """What each band and channel adds to the variances of ``R⁻¹Qᵀe``, ``(bands, channels, k)``."""
        inverse = np.asarray(np.linalg.solve(factor, np.eye(len(factor))), dtype=float)
        shares = np.zeros((*power.shape[:2], len(factor)))
        for b, trial, part in self._iterate_parts():
            x = _multiply_last_axis(trial.q[part], inverse.T)
            weight = trial.bins.weight[part] * trial.bins.colour[part]
            squared = np.einsum("f,fhck->ck", weight, np.square(x, out=x))
            shares[b] += squared * np.diag(power[b])[:, None]
        return shares


def _scale_columns(x: Array, weight: Array) -> Array:
    """Transformed columns ``(n_frequencies, …)`` by the root of a weight of each frequency."""
    return np.asarray(x * np.sqrt(weight)[:, None, None, None])


def _own_size(power: Array) -> Array:
    """Geometric mean of both channels' own power, for each pair, ``(n_bands, n_channels, n_channels)``."""
    own = np.sqrt(np.maximum(np.einsum("bcc->bc", power), _TINY))
    return np.asarray(own[:, :, None] * own[:, None, :])


def _multiply_last_axis(x: Array, matrix: Array) -> Array:
    """``x @ matrix`` over the last axis as one product."""
    return (x.reshape(-1, x.shape[-1]) @ matrix).reshape(x.shape)


def _channel_products(x: Array) -> Array:
    """``Σ_f Σ_h Σ_k x[f, h, c, k] x[f, h, d, k]``, ``(n_channels, n_channels)``."""
    x = x.transpose(2, 0, 1, 3).reshape(x.shape[2], -1)
    return x @ x.T


def _psd_root(matrix: Array) -> Array:
    """A root of symmetric matrices ``(…, n, n)``, what is negative of them left out."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


# The colour that a filter gives to noise, and frequencies at which the noise before it is alike.

# Below this share of its greatest power the filter leaves too little to learn the noise from.
_AUDIBLE = 0.05
# Below this share filtered noise adds nothing to any sum.
_PRESENT = 1e-7
# A band has to hold this many independent numbers that the fit has not taken, in every channel.
_FEWEST = 12.0
# Cells that bands are made of.
_CELLS = 256


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
    kept: Indices
    relative: Array
    colour: Array
    audible: Flags
    weight: Array

    def band(self, edges: Array) -> Indices:
        """Band of each frequency, ``(n_kept,)``."""
        return np.clip(np.searchsorted(edges, self.relative, side="right") - 1, 0, len(edges) - 2)


def trial_bins(problem: IdentificationProblem, grid: TrialGrid, n_fft: int) -> Bins:
    """The bins of a trial transformed over ``n_fft`` instants, with what the problem's filter leaves in each.

    White noise has power one before the zero-phase filter; decimation folds what lies above half the new rate.
    """
    rate, filters = 1.0 / grid.step_s, problem.filters
    sampling = problem.sampling_hz or rate
    relative = np.arange(n_fft // 2 + 1) * 2.0 / n_fft
    colour = np.ones_like(relative)
    if filters is not None and filters.cutoff_hz < 0.5 * sampling:
        folded = 0.5 * rate * relative + rate * np.arange(max(1, round(sampling / rate)))[:, None]
        amplitude = filter_amplitude(folded, filters.cutoff_hz, filters.order, sampling)
        colour = (amplitude**2).sum(axis=0)
    share = colour / colour.max()
    kept = np.flatnonzero(share > _PRESENT)
    weight = conjugate_counts(n_fft) / n_fft
    return Bins(n_fft, kept, relative[kept], colour[kept], share[kept] > _AUDIBLE, weight[kept])


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


def transformed_trial(
    problem: IdentificationProblem, grid: TrialGrid, q: Array, residual: Array
) -> TransformedTrial:
    """A trial's columns ``q`` ``(n_rows, k)`` and residual ``(n_rows,)`` transformed."""
    n_channels, k = len(problem.channel_names), q.shape[1]
    bins = trial_bins(problem, grid, next_fast_len(2 * grid.n_samples, real=True))

    def transform_columns(columns: Array) -> Array:
        spread = grid.spread(columns[grid.rows], problem.channel, n_channels)
        found = np.fft.rfft(spread, bins.n_fft, axis=0)[bins.kept]
        return np.stack([found.real, found.imag], axis=1)

    x = np.empty((len(bins.kept), 2, n_channels, k))
    for start in range(0, k, COLUMNS_AT_ONCE):
        part = slice(start, start + COLUMNS_AT_ONCE)
        x[:, :, :, part] = transform_columns(q[:, part])
    mask = grid.spread(np.ones(len(grid.rows)), problem.channel, n_channels)
    counts = mask.T @ mask if problem.freedom is None else np.diag(problem.numbers(grid.rows))
    return TransformedTrial(bins, x, transform_columns(residual), counts, grid.n_samples)


def band_edges(trials: tuple[TransformedTrial, ...]) -> Array:
    """Edges of the bands, as share of half the rate, ``(n_bands + 1,)``."""
    top = max(float(trial.bins.relative[trial.bins.audible].max()) for trial in trials)
    cells = np.zeros((3, _CELLS, trials[0].r.shape[2]))
    for trial in trials:
        bins, everywhere = trial.bins, np.ones(len(trial.bins.kept), dtype=bool)
        weight = np.where(bins.audible, bins.weight, 0.0)[:, None]
        absorbed = [
            np.einsum("fhck,fhck->fc", trial.q[part], trial.q[part]) for part in frequency_blocks(everywhere)
        ]
        for sums, of_bins in zip(
            cells,
            (
                weight / bins.colour[:, None] * (trial.r**2).sum(axis=1),
                weight * np.diag(trial.counts),
                weight * np.concatenate(absorbed),
            ),
            strict=True,
        ):
            cell = np.minimum((bins.relative / top * _CELLS).astype(np.int64), _CELLS - 1)
            np.add.at(sums, cell, of_bins)
    return np.concatenate([alike_bands(*cells) / _CELLS * top, [max(1.0, top)]])


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
    # One power for each channel, and the place of the cut.
    price = 0.5 * (power.shape[1] + 1.0) * np.log(max(float(counts.sum()), 2.0))

    def band_cost(low: int, high: int) -> float:
        level, total, lost = (one[low:high].sum(axis=0) for one in (power, counts, taken))
        seen = total > 0.0
        free = (total - lost)[seen]
        if (free < _FEWEST).any() or not seen.any():
            return np.inf
        return float(0.5 * (free * np.log(np.maximum(level[seen] / free, _TINY))).sum() + price)

    def best_bands(low: int, high: int) -> tuple[float, list[int]]:
        whole = band_cost(low, high)
        if high - low == 1:
            return whole, [low]
        middle = (low + high) // 2
        left, right = best_bands(low, middle), best_bands(middle, high)
        halves = left[0] + right[0]
        # With nothing to learn from on one side, the whole is the only choice.
        return (halves, left[1] + right[1]) if halves < whole else (whole, [low])

    return np.array(best_bands(0, len(power))[1])


def spilled_power(trial: TransformedTrial, band: Indices, n_bands: int) -> Array:
    """Power that noise of unit power in band b' has in the audible part of band b, per instant, ``(n_bands, n_bands)``.

    ``tr(W_b G_b')/n`` of the Toeplitz matrices of both: a record of finite length smears frequencies.

    Args:
        trial: the trial, whose bins are taken.
        band: band of each of its frequencies, ``(n_kept,)``.
        n_bands: number of bands.
    """
    bins = trial.bins
    seen, given = (np.zeros((n_bands, bins.n_fft // 2 + 1)) for _ in range(2))
    given[band, bins.kept] = bins.colour
    seen[band[bins.audible], bins.kept[bins.audible]] = 1.0 / bins.colour[bins.audible]
    lag = np.arange(bins.n_fft)
    pairs = np.maximum(0.0, 1.0 - np.minimum(lag, bins.n_fft - lag) / trial.n_samples)
    return np.asarray((np.fft.irfft(seen, bins.n_fft) * pairs) @ np.fft.irfft(given, bins.n_fft).T)


def frequency_blocks(chosen: Flags) -> Iterator[Indices]:
    """Places of the chosen frequencies ``(n_kept,)``, a few at a time, so that columns need no second copy."""
    places = np.flatnonzero(chosen)
    for start in range(0, len(places), FREQUENCIES_AT_ONCE):
        yield places[start : start + FREQUENCIES_AT_ONCE]
