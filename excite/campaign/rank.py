"""The verb ``rank``: condition numbers of motions, each alone and all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.display import Row, Tabled
from excite.errors import InputError
from excite.excitation.conditioning import Conditioning, compute_conditioning, motion_factor
from excite.motion.collection import MotionsLike, as_motions
from excite.progress import Progress, silent
from excite.regressor.base_parameters import structural_base_parameters
from excite.results import Name, Seconds, Stated, named
from excite.robot.load import RobotLike, as_robot


@dataclass(frozen=True)
class RankedMotion(Stated):
    """One motion's own conditioning.

    Attributes:
        motion: its name.
        duration_s: [s]
        conditioning: of the motion alone.
    """

    motion: Name
    duration_s: Seconds
    conditioning: Conditioning


@dataclass(frozen=True, repr=False)
class RankReport(Tabled, Stated):
    """Motions from the best to the worst, and all of them together.

    Attributes:
        robot: name of the robot.
        motions: best first: highest rank, then lowest full condition number, then median segment condition.
        together: conditioning of all motions stacked.
    """

    SCHEMA = "excite.rank/1"

    robot: Name
    motions: tuple[RankedMotion, ...]
    together: Conditioning = field(metadata=named("conditioning"))

    tables = ("motions", "segments")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: each motion alone, best first, or its condition number by segment."""
        if table == "motions":
            return [
                {
                    "motion": item.motion,
                    "duration_s": item.duration_s,
                    "rank": item.conditioning.rank,
                    "condition": item.conditioning.full,
                    "log_det": item.conditioning.log_det,
                }
                for item in self.motions
            ]
        return [one.row(motion=item.motion) for item in self.motions for one in item.conditioning.segments]

    def summary(self) -> str:
        """One line a motion, best first, then all together."""
        lines = [f"{item.motion}: {item.conditioning.summary()}" for item in self.motions]
        return "\n".join([*lines, f"together: {self.together.summary()}"])


def rank(robot: RobotLike, motions: MotionsLike, *, progress: Progress = silent) -> RankReport:
    """Rank motions by condition numbers, full (base columns) and per segment.

    Args:
        robot: the robot, or what :func:`~excite.robot.load.load_robot` takes.
        motions: what to rank: motions, files, folders.
        progress: told after each motion.

    Returns:
        The motions from the best to the worst, and all of them together.

    Raises:
        InputError: no motions.
        MotionError: a motion is not for this robot.
    """
    robot = as_robot(robot)
    motions = as_motions(motions, robot)
    if not motions:
        raise InputError("no motions to rank", remedy="name at least one")
    base = structural_base_parameters(robot)
    factors, ranked = [], []
    for done, motion in enumerate(motions, start=1):
        factors.append(motion_factor(robot, motion))
        ranked.append(
            RankedMotion(motion.name, motion.duration, compute_conditioning(robot, factors[-1:], base))
        )
        progress("rank", done, len(motions))
    ranked.sort(key=_ranking_key)
    return RankReport(robot.name, tuple(ranked), compute_conditioning(robot, factors, base))


def _ranking_key(item: RankedMotion) -> tuple[float, float, float, str]:
    found = item.conditioning
    segments = np.array([segment.condition for segment in found.segments])
    return -found.rank, found.full, float(np.median(segments)), item.motion
