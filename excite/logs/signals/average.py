"""Averaging the periods of a repeated motion."""

from __future__ import annotations

from dataclasses import dataclass

from excite.arrays import Array
from excite.errors import LogError


@dataclass(frozen=True, eq=False)
class PeriodAverage:
    """The mean period and the noise around it.

    Attributes:
        mean: ``(K, …)`` mean over the periods.
        std: ``(…)`` standard deviation of one sample about the mean, pooled over the period, the signal's
            unit; that of the mean itself is ``std / sqrt(n_periods)``.
        n_periods: number of periods averaged, M.
    """

    mean: Array
    std: Array
    n_periods: int


def average_periods(values: Array, samples_per_period: int, skip: int = 0) -> PeriodAverage:
    """Average the whole periods of a signal: x̄(k) = 1/M Σ x_m(k).

    (Xu et al., Dynamic identification of the KUKA LBR iiwa robot with retrieval of physical parameters
    using global optimization, IEEE Access 2020, eq. 11.) Samples after the last whole period are left out.

    Args:
        values: ``(n, …)``, uniformly sampled.
        samples_per_period: K.
        skip: periods left out at the start, while transients die down.

    Returns:
        Mean, noise, number of periods.

    Raises:
        LogError: there is no whole period.
    """
    n_periods = len(values) // samples_per_period - skip if samples_per_period > 0 else 0
    if n_periods < 1:
        raise LogError(
            f"{len(values)} samples hold no period of {samples_per_period} after {skip} skipped",
            field="samples_per_period",
            remedy="record whole periods",
        )
    start = skip * samples_per_period
    periods = values[start : start + n_periods * samples_per_period]
    periods = periods.reshape(n_periods, samples_per_period, *values.shape[1:])
    mean = periods.mean(axis=0)
    freedom = max(1, (n_periods - 1) * samples_per_period)
    std = (((periods - mean) ** 2).sum(axis=(0, 1)) / freedom) ** 0.5
    return PeriodAverage(mean=mean, std=std, n_periods=n_periods)
