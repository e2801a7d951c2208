"""Candidates from the optimiser: each start of its search is a candidate, repaired and judged like all others."""

from __future__ import annotations

import numpy as np

from excite.excitation.optimisation.family import FourierFamily
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.search import NAME, SearchSettings, optimise
from excite.excitation.optimisation.task import ExcitationTask
from excite.motion.generators.bodyparts import central_range, upper_body
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.safety.repairs.shares import Shares

HARMONICS = 5
# Period of the series [s]: the slowest joint's range takes one, within these bounds.
_PERIODS = (6.0, 20.0)


def optimised_candidates(
    robot: Robot, count: int, seed: int, *, jobs: int = 1, progress: Progress = silent
) -> list[Candidate]:
    """Optimised Fourier series within the share of the limits that repairs leave alone.

    Args:
        robot: an arm, or a robot whose upper body moves while its base stands still.
        count: number of starts; those that end in no safe motion are left out.
        seed: of all random numbers.
        jobs: number of processes; the candidates do not depend on it.
        progress: told after each solve.

    Raises:
        NoSolutionError: limits leave no room, or no start ended in a safe motion.
    """
    lower, upper = central_range(robot)
    own, shares = robot.limits, Shares()
    limits = JointLimits(
        lower=lower,
        upper=upper,
        velocity=shares.velocity * own.velocity,
        acceleration=shares.acceleration * own.acceleration,
        torque=shares.torque * own.torque,
    )
    moved = upper_body(robot)
    period = np.pi * ((upper - lower) / limits.velocity)[moved].max()
    family = FourierFamily(float(np.clip(period, *_PERIODS)), HARMONICS)
    task = ExcitationTask(robot, family, limits=limits)
    found = optimise(
        task, SearchSettings(starts=count, kicks=1, seed=seed), jobs=jobs, progress=progress
    ).found
    feet = tuple(foot.name for foot in robot.feet)
    return [
        Candidate(
            name=item.motion.name,
            generator=NAME,
            targets=item.motion.metadata.targets,
            seed=seed,
            posture=item.curve,
            speed=1.0,
            phases=(SupportPhase(0.0, item.curve.length, feet),) if feet else (),
        )
        for item in found
    ]
