"""What a search for candidates is: all of a plan's found together, where a generator draws each on its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from excite.motion.generators.candidate import Candidate
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot

if TYPE_CHECKING:
    from excite.campaign.candidates.series import SeriesSettings


@dataclass(frozen=True, eq=False)
class Asked:
    """What candidates are asked for.

    Attributes:
        robot: the robot.
        count: how many to try; what cannot be made safe may be left out.
        targets: joints to aim at; all, if empty.
        series: criterion and period of optimised series; None for the defaults.
        jobs: number of processes, or an executor; the candidates do not depend on it.
        progress: told as work proceeds.
        robust: whether limits shall hold for all robots of the set that the description states.
    """

    robot: Robot
    count: int
    targets: Sequence[str] = ()
    series: SeriesSettings | None = None
    jobs: Jobs = 1
    progress: Progress = silent
    robust: bool = False


class CandidateSearch(ABC):
    """Finds candidates together. A new one is one file beside this one and its line in ``SEARCHES``.

    Attributes:
        name: what users type after ``--generator``, beside the names of generators.
    """

    name: ClassVar[str]

    @abstractmethod
    def candidates(self, asked: Asked, seed: int) -> list[Candidate]:
        """The candidates of one seed.

        Raises:
            NoSolutionError: there are none.
            InputError: the robot, a target or a setting does not suit it.
        """
