"""What passes from repair to repair, and how one gives up."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from excite.motion.generators.generator import Candidate
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.repairs.collisions import CollisionProbe, TooClose
from excite.safety.repairs.path import MotionPath, TimeLaw
from excite.safety.repairs.rows import PathLimits, Shares


@dataclass(frozen=True)
class Rejection:
    """Why a candidate was given up.

    Attributes:
        candidate: its name.
        reason: short and countable, such as ``self_collision`` or ``zmp``.
        where: joint, foot or pair of links.
        time_s: time in the motion [s], None where it has no time law yet.
        value: the quantity that refuses it, None where there is no number.
        limit: what it must not pass, same unit.
        unit: of both, where that is not the usual one of the reason.
    """

    candidate: str
    reason: str
    where: str
    time_s: float | None = None
    value: float | None = None
    limit: float | None = None
    unit: str | None = None


@dataclass(frozen=True, eq=False)
class Draft:
    """A candidate on its way through the repairs; each fills in or replaces a part.

    Attributes:
        candidate: the candidate, perhaps with other control points than the generator drew.
        path: the whole robot's path, once the base and legs are known.
        limits: what limits the speed along the path, computed by the first repair that needs it.
        law: path parameter over time, once the path has a time law.
        motion: the samples, in the end.
    """

    candidate: Candidate
    path: MotionPath | None = None
    limits: PathLimits | None = None
    law: TimeLaw | None = None
    motion: Motion | None = None

    def rejected(
        self,
        reason: str,
        where: str,
        time_s: float | None = None,
        value: float | None = None,
        limit: float | None = None,
        unit: str | None = None,
    ) -> Rejection:
        """A rejection of this draft's candidate."""
        return Rejection(self.candidate.name, reason, where, time_s, value, limit, unit)


def refused_by(draft: Draft, near: TooClose, where: str = "{}") -> Rejection:
    """The rejection of a draft in which two bodies come too close; ``where`` holds their names."""
    return draft.rejected("self_collision", where.format(near.pair), value=near.distance, limit=near.required)


class Repair(ABC):
    """Makes a draft safer, or gives it up; it never judges the result.

    Attributes:
        name: registry name, also the name of the stage in timings.
        robot: the robot whose drafts it repairs.
        probe: its collisions; one of its own, if None is given.
        shares: how much of each limit to use; the default leaves the verdict a margin.
    """

    name: ClassVar[str]

    def __init__(
        self, robot: Robot, probe: CollisionProbe | None = None, shares: Shares | None = None
    ) -> None:
        self.robot, self.shares = robot, shares or Shares()
        self.probe = probe or CollisionProbe(robot)

    @abstractmethod
    def repair(self, draft: Draft) -> Draft | Rejection:
        """The repaired draft; ``draft`` itself is left as it is. The result depends on nothing else."""
