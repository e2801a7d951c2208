"""One spoilt motion on its way to a controller: refused, harmless, or out though it is unsafe."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from excite.errors import ExciteError
from excite.export.export import export_motion
from excite.motion.collection import library_folder
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.export.mutations import FLOATING, MUTATIONS, NEVER, spoilt
from tests.export.oracle import unsafe

# The shortest ready motions of an arm and of a humanoid.
STARTS = (
    ("ur10", "random_joint_015"),
    ("g1", "squat_009"),
    ("ur10", "random_joint_003"),
    ("g1", "random_joint_016"),
)
MUTATED = (*MUTATIONS, *FLOATING)
"""All ways to spoil a motion."""


@dataclass(frozen=True)
class Outcome:
    """What became of a spoilt motion.

    Attributes:
        robot: the robot's name.
        kind: how it was spoilt.
        seed: of it.
        refused: whether it was refused.
        left: names of what was written although it was refused.
        wrong: why what was exported must not be run, empty where nothing speaks against it.
    """

    robot: str
    kind: str
    seed: int
    refused: bool
    left: tuple[str, ...]
    wrong: tuple[str, ...]

    @property
    def good(self) -> bool:
        """Refused with nothing written, or exported and harmless."""
        return not self.left and not self.wrong


@lru_cache
def start(index: int) -> tuple[Robot, Motion]:
    """A robot and one of its ready motions."""
    name, motion = STARTS[index % len(STARTS)]
    robot = load_robot(name)
    return robot, load_motion(library_folder(name) / "motions" / f"{motion}.parquet", robot)


def kinds(index: int) -> list[str]:
    """Kinds of spoiling for a start."""
    return [*MUTATIONS, *(FLOATING if STARTS[index % len(STARTS)][0] == "g1" else ())]


def outcome(shared: None, task: tuple[int, str, int]) -> Outcome:
    """Spoil a motion, export it, and have what was written looked at."""
    index, kind, seed = task
    robot, motion = start(index)
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name), Path(name) / "out"
        moved = spoilt(robot, motion, kind, seed, folder)
        try:
            path = export_motion(moved, robot, "csv", out / "motion")
        except ExciteError:
            left = tuple(sorted(item.name for item in out.iterdir())) if out.exists() else ()
            return Outcome(robot.name, kind, seed, True, left, ())
        wrong = ["says what is not so"] if kind in NEVER else unsafe(robot, path)
        return Outcome(robot.name, kind, seed, False, (), tuple(wrong))


def cases(count: int) -> list[tuple[int, str, int]]:
    """Tasks for :func:`outcome`: starts in turn, each kind as often as any other."""
    found = []
    place = [0] * len(STARTS)
    for number in range(count):
        index = number % len(STARTS)
        several = kinds(index)
        found.append((index, several[place[index] % len(several)], number))
        place[index] += 1
    return found
