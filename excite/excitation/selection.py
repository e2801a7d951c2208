"""The choice of motions: the best few for every degree of freedom, or those that say most together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.excitation.conditioning import MotionFactor
from excite.excitation.greedy import (
    Criterion,
    Information,
    LogDeterminant,
    TotalDeviation,
    candidate_information,
    greedy_choice,
)
from excite.excitation.precision import nominal_values
from excite.excitation.ranking import Ranking
from excite.excitation.segment_choice import choose_by_segments, segment_information
from excite.excitation.sub_regressors import segment_columns
from excite.regressor.base_parameters import BaseParameters
from excite.robot.robot import Robot

# A base parameter smaller than this counts as negligible (Xu et al. 2020) [SI]: its RSD is not to decide.
NEGLIGIBLE = 0.01
BEST_THREE = "best_three"


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
        weighted: the same factors with rows divided by their noise; made on demand, as few rules need them.
        budget_s: total duration that a greedy choice stays within [s]; as long as the best three take, if None.
        limits: by segment, the condition number that is good enough.
    """

    robot: Robot
    ranking: Ranking
    factors: Sequence[MotionFactor]
    durations: Array
    base: BaseParameters
    weighted: Callable[[], Sequence[MotionFactor]]
    budget_s: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)


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
    known = candidate_information(candidates.weighted(), base)
    scale = np.maximum(np.abs(nominal_values(candidates.robot, base)), NEGLIGIBLE)
    return _select_greedily(candidates, known, TotalDeviation(known.back, scale))


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
