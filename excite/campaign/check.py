"""The verb ``check``: the independent verdict on several motions, rehearsed where a robot stands."""

from __future__ import annotations

from collections.abc import Mapping

from excite.errors import InputError
from excite.motion.collection import MotionsLike, as_motions
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.parameter_set import stated_parameters
from excite.safety.verdict import CheckReport, Verdict
from excite.simulation.rehearsal import rehearsed_verdict


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
