"""The verbs ``check`` and ``rank``: motions at hand, judged for safety and ranked by condition numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.display import Row, Tabled
from excite.errors import InputError
from excite.excitation.conditioning import Conditioning, compute_conditioning, motion_factor
from excite.motion.collection import MotionsLike, as_motions
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.regressor.base_parameters import structural_base_parameters
from excite.results import Name, Seconds, Stated, named
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.motion import refuse_time_faults
from excite.safety.parameter_set import stated_parameters
from excite.safety.verdict import CheckReport, Verdict
from excite.simulation.rehearsal import rehearsed_verdict

# The verb ``check``: the independent verdict on several motions, rehearsed where a robot stands.


def check(
    robot: RobotLike,
    motions: MotionsLike,
    *,
    robust: bool = False,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> CheckReport:
    """Judge motions independently of whatever planned them; those of a chain have to be among them all.

    Args:
        robot: the robot that shall run them, or what :func:`~excite.robot.load.load_robot` takes.
        motions: what to judge: motions, files, folders.
        robust: call a motion safe only if it is so for all robots of the set that the description states under
            ``uncertainty`` (or of its default). The margins over that set are computed in any case.
        jobs: number of processes, or an executor; the verdicts do not depend on it.
        progress: told after each motion.

    Motions of a robot that can fall, and that violate nothing, are run in simulation as well: what falls there, slips
    by more than 10 mm, touches itself or holds a drive at its limit is not safe.

    Returns:
        A verdict for each motion, with margins and first violations.

    Raises:
        InputError: no motions.
        RobotError: the identification that ``uncertainty`` names cannot be read.
    """
    robot = as_robot(robot)
    motions = as_motions(motions, robot)
    if not motions:
        raise InputError("no motions to check", remedy="name at least one")
    named = {motion.name: motion for motion in motions}
    tasks = ((motion, _chain_neighbours(motion, named)) for motion in motions)
    verdicts = in_order(
        _check_one,
        tasks,
        jobs=jobs,
        shared=(robot, robust),
        total=len(motions),
        stage="check",
        progress=progress,
    )
    return CheckReport(tuple(verdicts), tuple(robot.description.assumed), robot.name)


def _check_one(shared: tuple[Robot, bool], task: tuple[Motion, dict[str, Motion]]) -> Verdict:
    (robot, robust), (motion, neighbours) = shared, task
    parameters = stated_parameters(robot)
    verdict = check_motion(robot, motion, neighbours=neighbours, parameters=parameters, robust=robust)
    return rehearsed_verdict(robot, motion, verdict, robust=robust)


def _chain_neighbours(motion: Motion, named: Mapping[str, Motion]) -> dict[str, Motion]:
    """The motions of the chain that a motion says it is part of, as far as they are there."""
    found: dict[str, Motion] = {}
    for end in ("previous", "following"):
        name = getattr(motion.metadata, end)
        while name in named and name not in found:
            found[name] = named[name]
            name = getattr(named[name].metadata, end)
    return found


# The verb ``rank``: condition numbers of motions, each alone and all together.


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
        MotionError: a motion is not for this robot, or its samples are none that a controller could run.
    """
    robot = as_robot(robot)
    motions = as_motions(motions, robot)
    if not motions:
        raise InputError("no motions to rank", remedy="name at least one")
    base = structural_base_parameters(robot)
    factors, ranked = [], []
    for done, motion in enumerate(motions, start=1):
        refuse_time_faults(motion)
        factors.append(motion_factor(robot, motion))
        ranked.append(
            RankedMotion(motion.name, motion.duration, compute_conditioning(robot, factors[-1:], base))
        )
        progress("rank", done, len(motions))
    ranked.sort(
        key=lambda item: (
            -item.conditioning.rank,
            item.conditioning.full,
            float(np.median([segment.condition for segment in item.conditioning.segments])),
            item.motion,
        )
    )
    return RankReport(robot.name, tuple(ranked), compute_conditioning(robot, factors, base))
