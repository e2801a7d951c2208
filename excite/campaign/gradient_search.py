"""Motions designed by gradients as candidates: random ones are made safe, then each is designed for what is lacking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.campaign.optimised_series import Asked, CandidateSearch
from excite.errors import InputError, NoSolutionError
from excite.excitation.design_rows import DesignRows, design_rows
from excite.excitation.gradient_design import (
    GRADIENT,
    SEARCH_HZ,
    Design,
    design_motions,
    first_information,
)
from excite.excitation.selection import Criterion, LogDeterminant
from excite.excitation.targets import ReachedTargets
from excite.motion.generators.mixture import plan_proposals, usual_mix
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.worker import Shared
from excite.rows.settings import ProblemSettings
from excite.safety.filter import filter_candidates
from excite.simulation.rehearsal import can_fall, loaded_robot, rehearse_motions


class GradientDesign(CandidateSearch):
    """Splines added to safe random motions, those of the same minutes each for what the ones before lack.

    Of an arm all joints are designed, of a robot on force sensors base and joints, with the feet as in the source.

    Of parameters that are asked for by name it is how far they are from the target that counts, else the
    log-determinant; what motions that were run already tell is known.
    """

    name = GRADIENT
    # A second of processor time each, and three minutes of motion to choose from.
    usual_count = 24

    def candidates(self, asked: Asked, seed: int) -> list[Motion]:
        """See :class:`~excite.campaign.optimised_series.CandidateSearch`; one motion a safe random motion.

        Raises:
            NoSolutionError: no random motion is safe.
            UnknownNameError: a target is no joint of the robot.
            InputError: a robot without rows for it, or without stated noise; criterion or period asked for.
        """
        if asked.series is not None:
            raise InputError(
                "criterion and period are those of optimised_fourier", field="series", remedy="leave them out"
            )
        robot = asked.robot
        # What is chosen is rehearsed with a load on the robot's back.
        members = [loaded_robot(robot).truth.phi] if can_fall(robot) else []
        rows = design_rows(robot, members)
        mix = {"aimed" if asked.targets else "random_joint": 1.0}
        if robot.floating:
            mix = usual_mix(robot, aimed=bool(asked.targets))
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
        known = first_information(rows, kept)
        for motion in asked.before:
            sampled = motion.resampled(robot, SEARCH_HZ)
            known = known + rows.information(sampled.q, sampled.v, sampled.a)
        shared = Shared((rows, known, _criterion(rows, asked), asked.robust))
        sets = sets_within(kept, asked.budget_s)
        made: list[Motion] = []
        for designs in in_order(_design, sets, jobs=asked.jobs, shared=shared, stage="design"):
            made += [
                # What no step made safe is its source still, and is called so.
                one.motion.renamed(f"{one.motion.metadata.generator}_{len(made) + i:03d}")
                for i, one in enumerate(designs)
            ]
            asked.progress("design", len(made), len(kept))
        return made


def sets_within(motions: Sequence[Motion], budget_s: float | None) -> list[list[Motion]]:
    """Motions dealt into sets that fit into a time at the robot, each into the first that has room for it.

    Without a time they are two sets, a processor each.
    """
    if budget_s is None:
        return [one for one in (list(motions[::2]), list(motions[1::2])) if one]
    sets: list[list[Motion]] = []
    for motion in motions:
        for one in sets:
            if sum(other.duration for other in one) + motion.duration <= budget_s:
                one.append(motion)
                break
        else:
            sets.append([motion])
    return sets


def _criterion(rows: DesignRows, asked: Asked) -> Criterion:
    if not asked.parameters:
        return LogDeterminant()
    rows_hz = ProblemSettings().filters(floating=rows.robot.floating).rate_hz
    return ReachedTargets.of(
        rows.robot, rows.base, asked.parameters, target_rsd=asked.target_rsd, rows=SEARCH_HZ / rows_hz
    )


def _keep(_: object, motion: Motion) -> Motion:
    return motion


def _design(shared: tuple[DesignRows, Array, Criterion, bool], sources: list[Motion]) -> list[Design]:
    rows, start, criterion, robust = shared

    def stands(motion: Motion) -> bool:
        return rehearse_motions(rows.robot, [motion]) == (None,)

    return design_motions(rows, sources, start, criterion, robust=robust, stands=stands)
