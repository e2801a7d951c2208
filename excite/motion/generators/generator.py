"""What every generator of excitation motions is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from excite.errors import RobotError
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.proposal import Proposal
from excite.robot.robot import Robot


class Generator(ABC):
    """Proposes candidates; each depends only on the robot, its own seed and its targets.

    Attributes:
        name: name in the registry.
        summary: one line for lists of generators.
        needs: what a robot must have for it to apply, as the end of a sentence; empty where it always does.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[str] = ""

    @abstractmethod
    def applies(self, robot: Robot) -> bool:
        """Whether the generator has anything to propose for this robot."""

    @abstractmethod
    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Joints that this generator can aim at, in the order in which a plan goes through them."""

    @abstractmethod
    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """The candidate of one seed, aimed at the joints ``targets`` (none of them unknown)."""

    def candidates(
        self, robot: Robot, count: int, seed: np.random.SeedSequence, targets: Sequence[str] = ()
    ) -> list[Candidate]:
        """Draw ``count`` candidates, aimed at each of the targets in turn.

        Args:
            robot: the robot.
            count: how many.
            seed: candidate ``i`` comes from its child ``i``, whatever was spawned before.
            targets: joints to aim at in turn; all that the generator can aim at, if empty.

        Raises:
            UnknownNameError: a target is no joint of the robot.
            RobotError: the generator does not apply to the robot.
        """
        drawn = self.proposals(robot, count, seed, targets)
        return [self.draw(robot, item.seed, item.targets, item.name) for item in drawn]

    def proposals(
        self, robot: Robot, count: int, seed: np.random.SeedSequence, targets: Sequence[str] = ()
    ) -> Iterator[Proposal]:
        """What :meth:`candidates` draws, not drawn yet; same arguments and errors."""
        if not self.applies(robot):
            why = f": {self.needs}" if self.needs else ""
            raise RobotError(f"generator {self.name!r} does not apply to it{why}", source=robot.name)
        for joint in targets:
            robot.joint_index(joint)
        aims = tuple(targets) or self.aims(robot)
        return (
            Proposal(self.name, child_seed(seed, i), (aims[i % len(aims)],), f"{self.name}_{i:03d}")
            for i in range(count)
        )


def child_seed(seed: np.random.SeedSequence, index: int) -> int:
    """The integer seed of child ``index``; unlike ``spawn`` it leaves ``seed`` as it is."""
    entropy = seed.entropy if seed.entropy is not None else 0
    child = np.random.SeedSequence(entropy, spawn_key=(*seed.spawn_key, index))
    high, low = child.generate_state(2, np.uint32)
    # Below 2⁵³, so that every JSON reader keeps it exactly.
    return (int(high) & 0x1FFFFF) << 32 | int(low)
