"""Motions designed by gradients as candidates: random ones are made safe, then each is designed for what is lacking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.campaign.optimised_series import Asked, CandidateSearch, usual_limits
from excite.errors import InputError, NoSolutionError
from excite.excitation.gradient_design import ArmRows, Design, design_motion, first_information
from excite.excitation.optimisation.limits import JointLimits
from excite.motion.generators.generator import Candidate
from excite.motion.generators.mixture import plan_proposals
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import at_once
from excite.parallel.worker import Shared
from excite.safety.filter import filter_candidates

# Motions that are designed at the same time, for the same information: a processor each, and the same result whatever
# there are of them.
_AT_ONCE = 2


class GradientDesign(CandidateSearch):
    """Splines added to safe random motions, each for the log-determinant given those before (arms)."""

    name = "gradient"
    # A second of processor time each, and three minutes of motion to choose from.
    usual_count = 24

    def candidates(self, asked: Asked, seed: int) -> list[Candidate]:
        """See :class:`~excite.campaign.optimised_series.CandidateSearch`; one candidate a safe random motion.

        Raises:
            NoSolutionError: no random motion is safe.
            UnknownNameError: a target is no joint of the robot.
            InputError: no arm, or noise that the robot does not state; criterion or period asked for.
        """
        if asked.series is not None:
            raise InputError(
                "criterion and period are those of optimised_fourier", field="series", remedy="leave them out"
            )
        robot = asked.robot
        rows = ArmRows(robot)
        mix = {"aimed" if asked.targets else "random_joint": 1.0}
        proposals = plan_proposals(
            robot, asked.count, np.random.SeedSequence(seed), mix=mix, targets=asked.targets
        )
        kept = filter_candidates(
            robot, proposals, jobs=asked.jobs, total=asked.count, keep=_keep, robust=asked.robust
        ).kept
        if not kept:
            raise NoSolutionError(
                f"no random motion of {robot.name} is safe, from which one could be designed",
                remedy="ask for more candidates",
            )
        information = first_information(rows, kept)
        shared, made = Shared((rows, usual_limits(robot))), list[Candidate]()
        for start in range(0, len(kept), _AT_ONCE):
            tasks = [_Task(motion, information) for motion in kept[start : start + _AT_ONCE]]
            for design in in_order(_design, tasks, jobs=at_once(asked.jobs), shared=shared, stage="design"):
                information = information + design.information
                source = kept[len(made)].metadata
                # What no step made safe is its source still, and is called so.
                maker = self.name if design.step else source.generator
                name = f"{maker}_{len(made):03d}"
                made.append(Candidate(name, maker, source.targets, seed, design.curve, speed=1.0))
            asked.progress("design", len(made), len(kept))
        return made


@dataclass(frozen=True, eq=False)
class _Task:
    """A safe motion, and the information before it."""

    source: Motion
    information: Array


def _keep(_: object, motion: Motion) -> Motion:
    return motion


def _design(shared: tuple[ArmRows, JointLimits], task: _Task) -> Design:
    rows, limits = shared
    return design_motion(rows, task.source, task.information, limits)
