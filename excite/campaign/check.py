"""The verb ``check``: the independent verdict on several motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.errors import InputError, OtherRobotError
from excite.motion.collection import motion_paths
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.verdict import Margins, Verdict, Violation, check_document


@dataclass(frozen=True)
class CheckReport:
    """Verdicts on several motions.

    Attributes:
        verdicts: one a motion, in order.
    """

    verdicts: tuple[Verdict, ...]

    @property
    def safe(self) -> bool:
        """True if every motion is safe."""
        return all(verdict.safe for verdict in self.verdicts)

    def to_json(self) -> dict[str, Any]:
        """The ``excite.check/1`` document."""
        return check_document(self.verdicts)

    def summary(self) -> str:
        """One line a motion, then the total."""
        unsafe = sum(not verdict.safe for verdict in self.verdicts)
        total = f"all {len(self.verdicts)} safe" if not unsafe else f"{unsafe} of {len(self.verdicts)} unsafe"
        return "\n".join([*(verdict.summary() for verdict in self.verdicts), total])


def check(
    robot: Robot, motions: Sequence[Motion], *, jobs: Jobs = 1, progress: Progress = silent
) -> CheckReport:
    """Judge motions independently of whatever planned them; those of a chain have to be among them all.

    Args:
        robot: the robot that shall run them.
        motions: what to judge.
        jobs: number of processes, or an executor; the verdicts do not depend on it.
        progress: told after each motion.

    Raises:
        InputError: no motions.
    """
    if not motions:
        raise InputError("no motions to check", remedy="name at least one")
    named = {motion.name: motion for motion in motions}
    tasks = ((motion, _neighbours(motion, named)) for motion in motions)
    return CheckReport(
        tuple(
            in_order(
                _checked, tasks, jobs=jobs, shared=robot, total=len(motions), stage="check", progress=progress
            )
        )
    )


def check_files(
    robot: Robot, paths: Iterable[str | Path], *, jobs: Jobs = 1, progress: Progress = silent
) -> CheckReport:
    """Read motions and judge them; one that is another robot's is unsafe, whatever its joints.

    Args:
        robot: the robot that shall run them.
        paths: files of motions, or folders of them.
        jobs: number of processes, or an executor.
        progress: told after each motion.

    Raises:
        MotionError: a file cannot be read.
    """
    read = [_read(robot, path) for path in motion_paths(paths)]
    motions = [item for item in read if isinstance(item, Motion)]
    judged = iter(check(robot, motions, jobs=jobs, progress=progress).verdicts if motions else ())
    return CheckReport(tuple(next(judged) if isinstance(item, Motion) else item for item in read))


def _read(robot: Robot, path: Path) -> Motion | Verdict:
    """A motion to judge; of one whose joints are another robot's, the verdict."""
    try:
        return load_motion(path, robot)
    except OtherRobotError as error:
        found = Violation("other_robot", None, error.robot, None, None)
        return Verdict(path.stem, Margins(), (found,), readable=False)


def _checked(robot: Robot, task: tuple[Motion, dict[str, Motion]]) -> Verdict:
    motion, neighbours = task
    return check_motion(robot, motion, neighbours=neighbours)


def _neighbours(motion: Motion, named: Mapping[str, Motion]) -> dict[str, Motion]:
    """The motions of the chain that a motion says it is part of, as far as they are there."""
    found: dict[str, Motion] = {}
    for end in ("previous", "following"):
        name = getattr(motion.metadata, end)
        while name in named and name not in found:
            found[name] = named[name]
            name = getattr(named[name].metadata, end)
    return found
