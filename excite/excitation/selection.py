"""The choice of motions: the best few for every degree of freedom."""

from __future__ import annotations

from dataclasses import dataclass

from excite.errors import InputError
from excite.excitation.ranking import Ranking
from excite.robot.robot import Robot


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
