"""Choice of motions by the condition numbers that all segments' sub-regressors reach together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.excitation.conditioning import MotionFactor
from excite.threads import one_blas_thread

# A row below its limit by this factor is no longer worth seconds; what rows gain there counts this much.
_ENOUGH, _BEYOND = 0.9, 0.01
# Motions that the choice is begun with in turn, those first that alone come nearest to the limits.
_STARTS = 8
_LEAST_GAIN = 1e-9
# What a segment above its limit costs beside its excess: nothing at first, then more than all excesses together.
_EXCESS, _MISSED = 0.0, 1e4
# Share of the largest eigenvalue below which the smallest is rounding.
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class SegmentInformation:
    """Information matrices of candidates on each segment's columns.

    Attributes:
        segments: names of the segments.
        single: of each segment, ``(n_motions, k, k)``, k its number of columns [SI].
    """

    segments: tuple[str, ...]
    single: tuple[Array, ...]

    @property
    def n_motions(self) -> int:
        """Number of candidates."""
        return len(self.single[0])


def segment_information(
    factors: Sequence[MotionFactor], columns: Mapping[str, NDArray[np.int64]]
) -> SegmentInformation:
    """Information of candidates, each looked at once.

    Args:
        factors: one a candidate.
        columns: of each segment (:func:`~excite.excitation.sub_regressors.segment_columns`).
    """
    found: list[list[Array]] = [[] for _ in columns]
    for factor in factors:
        for matrices, own in zip(found, columns.values(), strict=True):
            part = factor.matrix[:, own]
            matrices.append(part.T @ part)
    return SegmentInformation(tuple(columns), tuple(np.array(matrices) for matrices in found))


@one_blas_thread
def choose_by_segments(
    information: SegmentInformation,
    durations: Array,
    budget_s: float,
    limits: Mapping[str, float] | None = None,
) -> tuple[int, ...]:
    """Motions that bring the segments' condition numbers below limits, or as low as they get.

    What is made small is the sum over segments of the square of log(condition/limit), where that is above the limit;
    then, from where that ends, first the number of segments above their limits. From each of several starts, motions
    are added, taken out or exchanged one by one while that helps. A condition number may grow with a motion more, so
    that choices are short. Squared condition numbers are those of information matrices, which serves to compare
    motions and not to say how well any of them does.

    Args:
        information: of the candidates.
        durations: ``(n_motions,)`` [s].
        budget_s: total duration that the choice stays within [s].
        limits: condition number that is good enough, by segment; 1, which none reaches, for those left out.

    Returns:
        Indices of the chosen candidates, increasing; empty where none fits.
    """
    limits = limits or {}
    goal = np.log([_ENOUGH * limits.get(segment, 1.0) for segment in information.segments])
    search = _Search(information, durations, budget_s, goal)
    alone = search.cost(information.single, _EXCESS)
    able = [int(i) for i in np.argsort(alone, kind="stable") if durations[i] <= budget_s]
    ends = []
    for start in able[:_STARTS]:
        chosen: tuple[int, ...] = (start,)
        for missed in (_EXCESS, _MISSED):
            chosen = search.descend(chosen, missed)
        ends.append((float(search.cost(search.together(chosen), _MISSED)), tuple(sorted(chosen))))
    return min(ends)[1] if ends else ()


@dataclass(frozen=True, eq=False)
class _Search:
    """Exchanges of single motions; ``missed`` is what a segment above its limit costs beside its excess."""

    information: SegmentInformation
    durations: Array
    budget_s: float
    goal: Array

    def together(self, chosen: Sequence[int]) -> list[Array]:
        """Information of several motions, one matrix ``(k, k)`` a segment."""
        return [matrices[list(chosen)].sum(axis=0) for matrices in self.information.single]

    def cost(self, sums: Sequence[Array], missed: float) -> Array:
        """Of information matrices ``(…, k, k)``, one stack a segment: ``(…)``."""
        total = np.zeros(sums[0].shape[:-2])
        for matrix, log_goal in zip(sums, self.goal, strict=True):
            values = np.linalg.eigvalsh(matrix)
            low = np.maximum(values[..., 0], _ROUNDING * values[..., -1])
            # No information at all counts as the worst condition number.
            known = low > 0.0
            ratio = np.where(known, values[..., -1] / np.where(known, low, 1.0), 1.0 / _ROUNDING)
            over = 0.5 * np.log(ratio) - log_goal
            total += np.maximum(over, 0.0) ** 2 + _BEYOND * over + missed * (over > -np.log(_ENOUGH))
        return total

    def descend(self, chosen: tuple[int, ...], missed: float) -> tuple[int, ...]:
        """The choice from which no single motion more, less or other helps."""
        while (better := self._improved(chosen, missed)) != chosen:
            chosen = better
        return chosen

    def _improved(self, chosen: tuple[int, ...], missed: float) -> tuple[int, ...]:
        now, better = float(self.cost(self.together(chosen), missed)), chosen
        single = self.information.single
        for rest in (chosen, *(chosen[:i] + chosen[i + 1 :] for i in range(len(chosen)))):
            room = self.budget_s - self.durations[list(rest)].sum()
            able = [i for i in range(len(self.durations)) if i not in rest and self.durations[i] <= room]
            so_far = self.together(rest)
            values = self.cost([s + m[able] for s, m in zip(so_far, single, strict=True)], missed)
            options = [(float(value), (*rest, i)) for value, i in zip(values, able, strict=True)]
            if rest:
                options.append((float(self.cost(so_far, missed)), rest))
            value, option = min(options, default=(np.inf, rest))
            if value < now - _LEAST_GAIN:
                now, better = value, option
        return better
