"""Greedy choice of motions by what they say together, within a total duration."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.errors import InputError
from excite.excitation.conditioning import MotionFactor, stack_factors
from excite.excitation.sub_regressors import RANK_TOLERANCE
from excite.regressor.base_parameters import BaseParameters
from excite.threads import one_blas_thread

# Information that a choice starts with, as share of all candidates': keeps criteria finite before rank is full.
_START = 1e-6
# Candidates of steepest promise that are tried in place of a chosen one.
_TRIED = 3
_ROUNDS = 3
# Gains below this are rounding.
_LEAST_GAIN = 1e-9
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Information:
    """Information matrices of candidates in coordinates in which all of them together have the identity.

    Attributes:
        single: ``(n_motions, k, k)`` of each candidate, k the rank of all together.
        back: ``(n_base, k)`` from these coordinates to the base parameters.
    """

    single: Array
    back: Array

    def of(self, chosen: Sequence[int]) -> Array:
        """Information of several candidates together, ``(k, k)``."""
        start = _START * np.eye(self.single.shape[1])
        return np.asarray(start + self.single[list(chosen)].sum(axis=0))


class Criterion(Protocol):
    """What a choice is to make large."""

    def value(self, information: Array) -> float:
        """How good an information matrix ``(k, k)`` is."""
        ...

    def gradient(self, information: Array) -> Array:
        """``(k, k)`` such that ``trace(gradient · G)`` is the first-order gain of a small addition ``G``."""
        ...


class LogDeterminant:
    """D-optimality: the log-determinant, which falls as the confidence ellipsoid's volume grows."""

    def value(self, information: Array) -> float:
        """``log det M``."""
        return float(2.0 * np.log(np.diag(np.linalg.cholesky(information))).sum())

    def gradient(self, information: Array) -> Array:
        """``M⁻¹``."""
        return np.asarray(np.linalg.inv(information), dtype=float)


@dataclass(frozen=True, eq=False)
class TotalDeviation:
    """Minus the sum of predicted relative standard deviations (an A-optimality).

    Attributes:
        back: ``(n_base, k)`` of the :class:`Information`.
        scale: ``(n_base,)`` what each standard deviation is divided by [SI].
    """

    back: Array
    scale: Array

    def value(self, information: Array) -> float:
        """``−Σ σ/scale`` with ``σ² = diag(T M⁻¹ Tᵀ)``."""
        return -float((self._std(information)[0] / self.scale).sum())

    def gradient(self, information: Array) -> Array:
        """``½ M⁻¹ Tᵀ diag(1/(σ scale)) T M⁻¹``."""
        std, solved = self._std(information)
        weight = 0.5 / (np.maximum(std, 1e-300) * self.scale)
        return (solved * weight) @ solved.T

    def _std(self, information: Array) -> tuple[Array, Array]:
        """Standard deviations ``(n_base,)`` and ``M⁻¹ Tᵀ``."""
        solved = cho_solve(cho_factor(information), self.back.T)
        return np.sqrt(np.einsum("bk,kb->b", self.back, solved)), solved


@one_blas_thread
def candidate_information(factors: Sequence[MotionFactor], base: BaseParameters) -> Information:
    """Information of candidates on the base parameters, whitened by that of all of them.

    Args:
        factors: one a candidate.
        base: structural base parameters.

    Raises:
        InputError: no factor, factors that do not fit together, or base parameters of other columns.
    """
    whole = stack_factors(factors)
    if base.names != whole.columns.names:
        raise InputError(
            "base parameters of other columns than the motion's", source=", ".join(whole.motions)
        )
    columns = base.independent
    # Columns of one length first: units would otherwise decide what counts as rank.
    length = np.linalg.norm(whole.matrix[:, columns], axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, values, vectors = np.linalg.svd(whole.matrix[:, columns] / length, full_matrices=False)
    kept = values > RANK_TOLERANCE * values[0]
    back = (vectors[kept] / values[kept, None]).T / length[:, None]
    single = np.empty((len(factors), back.shape[1], back.shape[1]))
    for place, factor in enumerate(factors):
        rows = factor.matrix[:, columns] @ back
        single[place] = rows.T @ rows
    return Information(single, back)


@one_blas_thread
def greedy_choice(
    information: Information, criterion: Criterion, durations: Array, budget_s: float
) -> tuple[int, ...]:
    """Candidates of greatest gain until the time is spent, then exchanges that gain more.

    Once by gain per second and once by gain; the better of the two stands (Leskovec et al. 2007: either alone
    can end arbitrarily far from the best choice within a budget).

    The gain of the log-determinant falls as the choice grows (it is submodular), so that a candidate whose old
    gain is already too small need not be judged again (Minoux 1978); for other criteria this is a heuristic.
    Exchanges follow Fedorov (1972): each chosen motion in turn makes place for the one that gains most.

    Args:
        information: of the candidates.
        criterion: what to make large.
        durations: ``(n_motions,)`` [s].
        budget_s: total duration that the choice stays within [s].

    Returns:
        Indices of the chosen candidates, increasing; empty where none fits.
    """
    found: list[list[int]] = []
    for price in (durations, np.ones_like(durations)):
        chosen = _select_forward(information, criterion, durations, budget_s, price, [])
        for _ in range(_ROUNDS):
            better = _exchange_motions(information, criterion, durations, budget_s, chosen)
            better = _select_forward(information, criterion, durations, budget_s, price, better)
            if better == chosen:
                break
            chosen = better
        found.append(chosen)
    best = max(found, key=lambda choice: criterion.value(information.of(choice)))
    return tuple(sorted(best))


def _select_forward(
    information: Information,
    criterion: Criterion,
    durations: Array,
    budget_s: float,
    price: Array,
    chosen: list[int],
) -> list[int]:
    """Add candidates of greatest gain for their price while they fit."""
    chosen = list(chosen)
    matrix, left = information.of(chosen), budget_s - float(durations[chosen].sum())
    now = criterion.value(matrix)
    # (minus the gain for its price, index, how many were chosen when it was judged)
    queue = [(-np.inf, index, -1) for index in range(len(durations)) if index not in chosen]
    while queue:
        bound, index, judged = heapq.heappop(queue)
        if durations[index] > left + _ROUNDING * budget_s:
            continue
        if judged < len(chosen):
            gain = criterion.value(matrix + information.single[index]) - now
            heapq.heappush(queue, (-gain / price[index], index, len(chosen)))
            continue
        if -bound <= 0.0:
            break
        chosen.append(index)
        left -= float(durations[index])
        matrix = information.of(chosen)
        now = criterion.value(matrix)
    return chosen


def _exchange_motions(
    information: Information, criterion: Criterion, durations: Array, budget_s: float, chosen: list[int]
) -> list[int]:
    chosen = list(chosen)
    now = criterion.value(information.of(chosen))
    for place in range(len(chosen)):
        rest = chosen[:place] + chosen[place + 1 :]
        room = budget_s * (1.0 + _ROUNDING) - float(durations[rest].sum())
        matrix = information.of(rest)
        able = np.array([i for i in range(len(durations)) if i not in chosen and durations[i] <= room], int)
        for index in _most_promising(information, criterion.gradient(information.of(chosen)), able):
            value = criterion.value(matrix + information.single[index])
            if value > now + _LEAST_GAIN * abs(now):
                chosen[place], now = int(index), value
    return chosen


def _most_promising(information: Information, gradient: Array, able: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of ``able`` with the largest first-order gain, the earlier first of equals."""
    if not len(able):
        return able
    slope = np.einsum("mij,ij->m", information.single[able], gradient)
    return able[np.argsort(-slope, kind="stable")[:_TRIED]]
