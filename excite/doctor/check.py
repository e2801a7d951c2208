"""What every check of a log says of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from excite.doctor.doubt import Doubt
from excite.finding import Finding
from excite.logs.log import Log
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a check made of a log.

    Attributes:
        log: the log, repaired where that is sound; the one that was handed in where nothing was.
        findings: what was found.
        doubts: what the log tells only about, as far as what was found could not be repaired to the last.
    """

    log: Log
    findings: tuple[Finding, ...] = ()
    doubts: frozenset[Doubt] = frozenset()


class Check(ABC):
    """Looks a log through for one kind of fault, and repairs it where that is sound.

    Attributes:
        kinds: kinds of the findings that it may give.
    """

    kinds: ClassVar[tuple[str, ...]]

    @abstractmethod
    def examine(self, robot: Robot, log: Log) -> Outcome:
        """Find, and repair where that is sound.

        Args:
            robot: the nominal model.
            log: the log, as the checks before have left it.
        """
