"""Essential parameters: base parameters without those that say nothing (Xu et al. 2020, end of II.A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from excite.arrays import Array
from excite.identification.statistics import relative_percent

SHARE_BELOW = 0.01
"""Part of the measured channels below which a parameter may go: the figure of Xu et al. 2020, who mean SI values.

A value in SI units would keep other parameters of a robot of ten times the mass, or of another unit of length.
"""
RSD_ABOVE = 40.0


class Solved(Protocol):
    """Least squares on base parameters, found or predicted: see ``BaseStatistics`` for the symbols."""

    @property
    def estimate(self) -> Array:
        """Base parameters, ``(n_base,)`` [SI]."""

    @property
    def factor(self) -> Array:
        """``R`` of the weighted rows on them, ``(n_base, n_base)``."""

    @property
    def meat(self) -> Array:
        """Middle of the sandwich covariance, ``(n_base, n_base)``."""

    @property
    def rotated(self) -> Array:
        """``Qᵀ`` of the weighted measurement, ``(n_base,)``."""


@dataclass(frozen=True, eq=False)
class EssentialParameters:
    """What is left of the base parameters after elimination.

    Attributes:
        kept: ``(n_essential,)`` indices of base parameters.
        removed: indices in the order of their removal.
        values: ``(n_essential,)`` re-estimated values [SI].
        std: ``(n_essential,)`` their standard deviations.
        rsd_percent: ``(n_essential,)``.
    """

    kept: NDArray[np.int64]
    removed: tuple[int, ...]
    values: Array
    std: Array
    rsd_percent: Array


def essential_parameters(
    statistics: Solved, *, share_below: float = SHARE_BELOW, rsd_above: float = RSD_ABOVE
) -> EssentialParameters:
    """Remove, one at a time and re-estimating, the worst of the small and poorly determined parameters.

    A parameter is a candidate while what it adds to the weighted channels, ``‖column‖·|value|``, is below
    ``share_below`` of what all add together, and its RSD above ``rsd_above`` percent (Xu et al. 2020: a value below
    0.01 and 40 %); of the candidates the one of greatest RSD goes.

    Args:
        statistics: least squares on base parameters.
        share_below: share of the channels below which a parameter may go.
        rsd_above: relative standard deviation above which it may go [percent].
    """
    # The value with which a parameter alone would make all of the signal.
    lengths = np.maximum(np.linalg.norm(statistics.factor, axis=0), np.finfo(float).tiny)
    least = share_below * np.linalg.norm(statistics.rotated) / lengths
    kept = np.arange(len(statistics.estimate))
    removed: list[int] = []
    factor, rotated, meat = statistics.factor, statistics.rotated, statistics.meat
    while True:
        values = solve_triangular(factor, rotated)
        inverse = solve_triangular(factor, np.eye(len(kept)))
        std = np.sqrt(np.einsum("ij,jk,ik->i", inverse, meat, inverse, optimize=True))
        rsd = relative_percent(std, values)
        candidates = (np.abs(values) < least[kept]) & (rsd > rsd_above)
        if not candidates.any() or len(kept) == 1:
            return EssentialParameters(kept, tuple(removed), values, std, rsd)
        worst = int(np.argmax(np.where(candidates, rsd, -1.0)))
        removed.append(int(kept[worst]))
        kept = np.delete(kept, worst)
        rotation, factor = np.linalg.qr(np.delete(factor, worst, axis=1))
        rotated, meat = rotation.T @ rotated, rotation.T @ meat @ rotation
