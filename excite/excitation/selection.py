"""The choice of motions: the best few for every degree of freedom, or those that say most together."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array, Indices
from excite.errors import InputError, UnknownNameError
from excite.excitation.conditioning import (
    RANK_TOLERANCE,
    MotionFactor,
    Ranking,
    segment_columns,
    stack_factors,
)
from excite.excitation.precision import nominal_values
from excite.excitation.targets import NEGLIGIBLE, ReachedTargets
from excite.regressor.base_parameters import BaseParameters
from excite.robot.robot import Robot
from excite.threads import one_blas_thread

# Greedy choice of motions by what they say together, within a total duration.

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
        before: ``(k, k)`` of what is known already.
    """

    single: Array
    back: Array
    before: Array

    def of(self, chosen: Sequence[int]) -> Array:
        """Information of several candidates and of what was before them together, ``(k, k)``."""
        return np.asarray(self.before + self.single[list(chosen)].sum(axis=0))


class Criterion(Protocol):
    """What a choice is to make large."""

    def value(self, information: Array) -> float:
        """How good an information matrix ``(k, k)`` is."""

    def gradient(self, information: Array) -> Array:
        """``(k, k)`` such that ``trace(gradient · G)`` is the first-order gain of a small addition ``G``."""


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
def candidate_information(
    factors: Sequence[MotionFactor], base: BaseParameters, before: Sequence[MotionFactor] = ()
) -> Information:
    """Information of candidates on the base parameters, whitened by that of all of them.

    Args:
        factors: one a candidate.
        base: structural base parameters.
        before: of motions that were run already.

    Raises:
        InputError: no factor, factors that do not fit together, or base parameters of other columns.
    """
    whole = stack_factors([*factors, *before])
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

    def squared(some: Sequence[MotionFactor]) -> Array:
        rows = (factor.matrix[:, columns] @ back for factor in some)
        return np.array([one.T @ one for one in rows]).reshape(len(some), *2 * back.shape[1:])

    known = _START * np.eye(back.shape[1]) + squared(before).sum(axis=0)
    return Information(squared(factors), back, known)


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


def _most_promising(information: Information, gradient: Array, able: Indices) -> Indices:
    """Those of ``able`` with the largest first-order gain, the earlier first of equals."""
    slope = np.einsum("mij,ij->m", information.single[able], gradient)
    return able[np.argsort(-slope, kind="stable")[:_TRIED]]


# Choice of motions by the condition numbers that all segments' sub-regressors reach together.

# A row below its limit by this factor is no longer worth seconds; what rows gain there counts this much.
_ENOUGH, _BEYOND = 0.9, 0.01
# Motions that the choice is begun with in turn, those first that alone come nearest to the limits.
_STARTS = 8
# What a segment above its limit costs beside its excess: nothing at first, then more than all excesses together.
_EXCESS, _MISSED = 0.0, 1e4
# Share of the largest eigenvalue below which the smallest is rounding.
_SEGMENT_CHOICE_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class SegmentInformation:
    """Information matrices of candidates on each segment's columns.

    Attributes:
        segments: names of the segments.
        single: of each segment, ``(n_motions, k, k)``, k its number of columns [SI].
    """

    segments: tuple[str, ...]
    single: tuple[Array, ...]


def segment_information(
    factors: Sequence[MotionFactor], columns: Mapping[str, Indices]
) -> SegmentInformation:
    """Information of candidates, each looked at once.

    Args:
        factors: one a candidate.
        columns: of each segment (:func:`~excite.excitation.conditioning.segment_columns`).
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
            low = np.maximum(values[..., 0], _SEGMENT_CHOICE_ROUNDING * values[..., -1])
            # No information at all counts as the worst condition number.
            known = low > 0.0
            ratio = np.where(
                known, values[..., -1] / np.where(known, low, 1.0), 1.0 / _SEGMENT_CHOICE_ROUNDING
            )
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


BEST_THREE, TARGETS = "best_three", "targets"


@dataclass(frozen=True)
class SelectedMotion:
    """A motion that goes on, and what for.

    Attributes:
        index: its place among the ranked motions.
        motion: its name.
        segments: names of the segments that it is among the best for.
    """

    index: int
    motion: str
    segments: tuple[str, ...]


@dataclass(frozen=True)
class Selection:
    """The motions that go on.

    Attributes:
        selected: in the order of the ranked motions.
        short: segments that fewer motions excite than were asked for; those that none excites among them.
        unserved: segments that no motion excites to full rank.
        unseen: segments that the robot's sensors do not see, or that have no parameter of their own.
    """

    selected: tuple[SelectedMotion, ...]
    short: tuple[str, ...]
    unserved: tuple[str, ...]
    unseen: tuple[str, ...]

    @property
    def indices(self) -> tuple[int, ...]:
        """Places of the selected motions among the ranked ones, increasing."""
        return tuple(motion.index for motion in self.selected)


def best_three_per_dof(robot: Robot, ranking: Ranking, count: int = 3) -> Selection:
    """The union of the best motions of every segment, each of which is one degree of freedom.

    Jovic et al. (2015), II.B: the first three most exciting motions per DoF, with the lowest condition
    number of the segment's sub-regressor; the other motions are discarded.

    Args:
        robot: the robot.
        ranking: of the candidates.
        count: how many motions each segment gets.

    Raises:
        InputError: ``count`` is below one.
    """
    if count < 1:
        raise InputError(f"{count} motions a segment", field="count", remedy="ask for at least one")
    served: dict[int, list[str]] = {}
    short, unserved = [], []
    for segment in ranking.segments:
        best = ranking.best(segment)[:count]
        for index in best:
            served.setdefault(index, []).append(segment)
        if len(best) < count:
            short.append(segment)
        if not best:
            unserved.append(segment)
    selected = tuple(SelectedMotion(i, ranking.motions[i], tuple(served[i])) for i in sorted(served))
    unseen = tuple(segment.name for segment in robot.segments if segment.name not in ranking.segments)
    return Selection(selected, tuple(short), tuple(unserved), unseen)


@dataclass(frozen=True, eq=False)
class Candidates:
    """What motions are chosen from.

    Attributes:
        robot: the robot.
        ranking: of the motions.
        factors: R factor of each.
        durations: ``(n_motions,)`` [s].
        base: structural base parameters.
        weighted: the same factors with rows divided by their noise, and those of motions that were run already; made
            on demand, as few rules need them.
        budget_s: total duration that a greedy choice stays within [s]; as long as the best three take, if None.
        limits: by segment, the condition number that is good enough.
        asked: targets such as ``joint:friction``; all parameters, if empty.
        target_rsd: relative standard deviation that they are to reach [percent].
        rows_hz: independent rows a second that identification makes of a log.
    """

    robot: Robot
    ranking: Ranking
    factors: Sequence[MotionFactor]
    durations: Array
    base: BaseParameters
    weighted: Callable[[], tuple[Sequence[MotionFactor], Sequence[MotionFactor]]]
    budget_s: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    asked: tuple[str, ...] = ()
    target_rsd: float = 15.0
    rows_hz: float = 10.0

    def known(self) -> Information:
        """Information of the candidates, and of what was run before them, over the noise."""
        own, before = self.weighted()
        return candidate_information(own, self.base, before)


def by_best_three(candidates: Candidates) -> Selection:
    """The best three motions of every segment (:func:`best_three_per_dof`)."""
    return best_three_per_dof(candidates.robot, candidates.ranking)


def by_log_det(candidates: Candidates) -> Selection:
    """Greedy by the log-determinant of the information matrix, within the budget."""
    return _select_greedily(
        candidates, candidate_information(candidates.factors, candidates.base), LogDeterminant()
    )


def by_rsd(candidates: Candidates) -> Selection:
    """Greedy by the sum of predicted relative standard deviations, within the budget.

    A parameter's deviation is taken relative to its value in the model, or to 0.01 where that is smaller.
    """
    base = candidates.base
    known, scale = candidates.known(), np.maximum(np.abs(nominal_values(candidates.robot, base)), NEGLIGIBLE)
    return _select_greedily(candidates, known, TotalDeviation(known.back, scale))


def by_targets(candidates: Candidates) -> Selection:
    """Greedy by what is asked for as far as all candidates reach it; values below 0.01 are no target unless named."""
    known = candidates.known()
    criterion = ReachedTargets.of(
        candidates.robot,
        candidates.base,
        candidates.asked,
        target_rsd=candidates.target_rsd,
        rows=candidates.factors[0].rate_hz / candidates.rows_hz,
        back=known.back,
    )
    return _select_greedily(candidates, known, criterion.within(known.before + known.single.sum(axis=0)))


def by_segments(candidates: Candidates) -> Selection:
    """Few motions that together give every segment a low condition number, within the budget."""
    columns = segment_columns(candidates.robot, candidates.factors[0].columns, candidates.base)
    known = segment_information(candidates.factors, columns)
    chosen = choose_by_segments(known, candidates.durations, _duration_budget(candidates), candidates.limits)
    return _build_selection(candidates, chosen)


SELECTIONS: dict[str, Callable[[Candidates], Selection]] = {
    BEST_THREE: by_best_three,
    "log_det": by_log_det,
    "rsd": by_rsd,
    TARGETS: by_targets,
    "segments": by_segments,
}


def select_motions(name: str, candidates: Candidates) -> Selection:
    """Choose motions by a rule of ``SELECTIONS``.

    Raises:
        UnknownNameError: no such rule.
    """
    check_selection(name)
    return SELECTIONS[name](candidates)


def check_selection(name: str) -> None:
    """Raise UnknownNameError where no rule has this name."""
    if name not in SELECTIONS:
        raise UnknownNameError("selection", name, list(SELECTIONS))


def _select_greedily(candidates: Candidates, known: Information, criterion: Criterion) -> Selection:
    chosen = greedy_choice(known, criterion, candidates.durations, _duration_budget(candidates))
    return _build_selection(candidates, chosen)


def _duration_budget(candidates: Candidates) -> float:
    """Total duration that a choice stays within [s]."""
    if candidates.budget_s is not None:
        return candidates.budget_s
    best = best_three_per_dof(candidates.robot, candidates.ranking)
    return float(candidates.durations[list(best.indices)].sum())


def _build_selection(candidates: Candidates, chosen: Sequence[int]) -> Selection:
    """A choice, each motion with the segments that it is among the best three of the chosen for."""
    robot, ranking = candidates.robot, candidates.ranking
    best = best_three_per_dof(robot, ranking)
    served: dict[int, list[str]] = {index: [] for index in chosen}
    for segment in ranking.segments:
        for index in [i for i in ranking.best(segment) if i in served][:3]:
            served[index].append(segment)
    selected = tuple(SelectedMotion(i, ranking.motions[i], tuple(served[i])) for i in chosen)
    return Selection(selected, best.short, best.unserved, best.unseen)
