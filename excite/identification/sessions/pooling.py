"""Estimates of several sessions pooled: what they agree on, and how far they lie apart (random effects)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaincinv, ndtr, ndtri

from excite.arrays import Array
from excite.errors import InputError

_ROUNDS = 200
_TOLERANCE = 1e-10
_QUANTILES = 100
_BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class Pooled:
    """Parameters over sessions, ``k`` of them.

    Attributes:
        mean: ``(k,)`` pooled values.
        covariance: ``(k, k)`` of ``mean``.
        between: ``(k,)`` standard deviation of the true values from session to session.
        inconsistency: ``(k,)`` share of the spread of the sessions' estimates that is no noise, 0 to 1
            (``I²`` of Higgins and Thompson 2002).
        mean_interval: ``(2, k)`` holds the mean over all possible sessions with the probability asked for.
        next_interval: ``(2, k)`` holds the true value in a session yet to come with that probability.
        level: that probability.
    """

    mean: Array
    covariance: Array
    between: Array
    inconsistency: Array
    mean_interval: Array
    next_interval: Array
    level: float

    def varies(self, n_sessions: int) -> NDArray[np.bool_]:
        """Which parameters' sessions lie further apart than their own intervals allow, ``(k,)``.

        Cochran's ``Q``, at the intervals' level for all parameters together (Bonferroni).
        """
        q = (n_sessions - 1) / np.maximum(1.0 - self.inconsistency, 1e-12)
        chance = chdtrc(n_sessions - 1, q)
        return np.asarray((self.inconsistency > 0.0) & (chance < (1.0 - self.level) / len(self.mean)))

    @property
    def next_std(self) -> Array:
        """Standard deviation of a normal distribution as wide as ``next_interval``, ``(k,)``."""
        quantile = float(ndtri(0.5 * (1.0 + self.level)))
        return np.asarray(0.5 * (self.next_interval[1] - self.next_interval[0]) / quantile)


def pool_estimates(values: Array, covariances: Array, level: float = 0.95) -> Pooled:
    """Pool estimates by the multivariate random-effects model ``values[s] = mean + b_s + e_s``.

    ``e_s`` has the covariance given, ``b_s`` independent components whose variances are found for each
    parameter by restricted maximum likelihood (Viechtbauer 2005, eq. 8), never below zero.

    Args:
        values: ``(n_sessions, k)`` estimates.
        covariances: ``(n_sessions, k, k)`` of their errors.
        level: of the intervals.

    Raises:
        InputError: fewer than two sessions.
    """
    if len(values) < 2:
        raise InputError(
            f"{len(values)} session", field="sessions", remedy="pool at least two, better five or more"
        )
    variances = np.maximum(np.einsum("skk->sk", covariances), 1e-300)
    between = between_variance(values, variances)
    fixed = 1.0 / variances
    center = (fixed * values).sum(axis=0) / fixed.sum(axis=0)
    q = (fixed * (values - center) ** 2).sum(axis=0)
    information, moment = _joint_information(values, covariances, between)
    covariance = np.asarray(np.linalg.inv(information), dtype=float)
    size = np.sqrt(np.diag(covariance))
    return Pooled(
        mean=size * (covariance / np.outer(size, size) @ (size * moment)),
        covariance=covariance,
        between=np.sqrt(between),
        inconsistency=np.clip(1.0 - (len(values) - 1) / np.maximum(q, 1e-300), 0.0, 1.0),
        mean_interval=_parameter_interval(values, variances, level, of_next=False),
        next_interval=_parameter_interval(values, variances, level, of_next=True),
        level=level,
    )


def between_variance(values: Array, variances: Array) -> Array:
    """Variance between sessions of each parameter by restricted maximum likelihood, ``(k,)``.

    Args:
        values: ``(n_sessions, k)``.
        variances: ``(n_sessions, k)`` of the estimates' own errors.
    """
    n = len(values)
    # Units in which a typical error is one, so that one tolerance serves all.
    unit = np.maximum(variances.mean(axis=0), 1e-300)
    y, v = values / np.sqrt(unit), variances / unit
    start = np.maximum(0.0, y.var(axis=0, ddof=1) - v.mean(axis=0))
    between = start
    for _ in range(_ROUNDS):
        w = 1.0 / (v + between)
        mean = (w * y).sum(axis=0) / w.sum(axis=0)
        new = (w**2 * ((y - mean) ** 2 * n / (n - 1) - v)).sum(axis=0) / (w**2).sum(axis=0)
        new = np.maximum(0.0, new)
        done = np.abs(new - between) <= _TOLERANCE * (1.0 + new)
        between = new
        if done.all():
            break
    return np.asarray(between * unit)


def _joint_information(values: Array, covariances: Array, between: Array) -> tuple[Array, Array]:
    """Sum of the inverse covariances and of them times the values."""
    k = values.shape[1]
    information, moment = np.zeros((k, k)), np.zeros(k)
    for value, covariance in zip(values, covariances, strict=True):
        total = covariance + np.diag(between)
        # Parameters of all sizes: scale to unit diagonal before inverting.
        size = np.sqrt(np.diag(total))
        inverse = np.linalg.inv(total / np.outer(size, size)) / np.outer(size, size)
        inverse = 0.5 * (inverse + inverse.T)
        information += inverse
        moment += inverse @ value
    return information, moment


def _parameter_interval(values: Array, variances: Array, level: float, *, of_next: bool) -> Array:
    """Interval of each parameter's mean, or of its value in another session, ``(2, k)``.

    With few sessions the variance between them is hardly known, and an interval that takes its estimate for
    the truth is too narrow. The generalised ``Q(τ²) = Σ w (y − μ)²`` with ``w = 1/(v + τ²)`` is chi-square with
    ``n − 1`` degrees of freedom at the true τ² (Viechtbauer 2007), which gives the confidence distribution of
    τ²; the interval is that of the normal distributions mixed over it (Nagashima, Noma and Furukawa 2019).
    """
    n = len(values)
    unit = np.maximum(variances.mean(axis=0), 1e-300)
    y, v = values / np.sqrt(unit), variances / unit
    center = y.mean(axis=0)
    y = y - center
    wanted = 2.0 * gammaincinv(0.5 * (n - 1), (np.arange(_QUANTILES) + 0.5) / _QUANTILES)[:, None]
    between = _profile_tau(y, v, wanted)
    w = 1.0 / (v[:, None, :] + between)
    total = w.sum(axis=0)
    mean = (w * y[:, None, :]).sum(axis=0) / total
    std = np.sqrt(1.0 / total + (between if of_next else 0.0))
    edges = [_mixture_quantile(mean, std, p) for p in (0.5 * (1.0 - level), 0.5 * (1.0 + level))]
    return np.asarray(np.stack(edges) * np.sqrt(unit) + center * np.sqrt(unit))


def _profile_tau(y: Array, v: Array, wanted: Array) -> Array:
    """τ² at which ``Q`` is ``wanted``, zero where it is smaller for every τ², ``(n_quantiles, k)``."""

    def excess(between: Array) -> Array:
        w = 1.0 / (v[:, None, :] + between)
        mean = (w * y[:, None, :]).sum(axis=0) / w.sum(axis=0)
        return np.asarray((w * (y[:, None, :] - mean) ** 2).sum(axis=0) - wanted)

    shape = (len(wanted), y.shape[1])
    low, high = np.zeros(shape), np.broadcast_to((y**2).sum(axis=0) / wanted, shape).copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        above = excess(middle) > 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(0.5 * (low + high))


def _mixture_quantile(mean: Array, std: Array, probability: float) -> Array:
    """Quantile of equal mixtures of normal distributions, ``(k,)``."""
    reach = 9.0 * std.max(axis=0)
    low, high = mean.min(axis=0) - reach, mean.max(axis=0) + reach
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = ndtr((middle - mean) / std).mean(axis=0) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))
