"""Rehearsal: before a motion is chosen it is run in simulation, on the model and on a heavier robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from joblib import Parallel, delayed

from excite.motion.motion import Motion
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.simulation.replay import replay

# A robot weighs more than its model says (Jovic et al. 2016: 5 kg on 58 kg); on one leg that is what tips it.
HEAVIER = 0.15


def rehearse(
    robot: Robot, motions: Sequence[Motion], *, jobs: int = 1, progress: Progress = silent
) -> tuple[bool, ...]:
    """Whether a standing robot stays on its feet and clear of itself in each motion.

    Motions with both feet down are run on the nominal model; those that stand on one foot with all masses
    15 % larger, which is the harder of the two.
    A robot without feet has nothing to fall from: all its motions pass.

    Args:
        robot: the robot.
        motions: what to run, in MuJoCo with contacts and the robot's position servo.
        jobs: number of processes; the answer does not depend on it.
        progress: told after each motion.
    """
    if not robot.feet or not robot.floating:
        return (True,) * len(motions)
    verdicts: list[bool] = []
    for verdict in Parallel(n_jobs=jobs, return_as="generator")(_tasks(robot, motions)):
        verdicts.append(verdict)
        progress("rehearse", len(verdicts), len(motions))
    return tuple(verdicts)


def _tasks(robot: Robot, motions: Sequence[Motion]) -> Iterable:
    return (delayed(_stands)(robot, motion) for motion in motions)


def _stands(robot: Robot, motion: Motion) -> bool:
    lifts_a_foot = not all(flags.all() for flags in motion.contacts.values())
    return replay(robot, motion, mass_error=HEAVIER if lifts_a_foot else 0.0).on_its_feet
