"""Motions designed by gradients as candidates: random ones are made safe, then each is designed for what is lacking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.campaign.expected import filtered_noise
from excite.campaign.optimised_series import Asked, CandidateSearch
from excite.errors import InputError, NoSolutionError
from excite.excitation.design_rows import SEARCH_HZ, DesignRows, design_rows
from excite.excitation.gradient_design import (
    GRADIENT,
    Design,
    design_motions,
    first_information,
)
from excite.excitation.selection import Criterion, Information, LogDeterminant, greedy_choice
from excite.excitation.targets import ReachedTargets
from excite.motion.generators.mixture import plan_proposals, usual_mix
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.worker import Shared
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.safety.filter import filter_candidates
from excite.simulation.rehearsal import can_fall, loaded_robot, rehearse_motions


class GradientDesign(CandidateSearch):
    """Splines added to safe random motions, those of the same minutes each for what the ones before lack.

    Of an arm all joints are designed, of a robot on force sensors base and joints, with the feet as in the source. What
    stands takes ten times as long: of its minutes those are designed that would be chosen as they are, and as many
    others go along undesigned.

    Of parameters that are asked for by name it is how far they are from the target that counts, and in minutes of what
    stands of all whose values count, as most of its are too small; else the log-determinant. What motions that were run
    already tell is known.
    """

    name = GRADIENT

    def usual_count(self, robot: Robot) -> int | None:
        """Of arms 24, a second of processor time each and three minutes of motion to choose from."""
        return None if robot.floating else 24

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
        mix = {"aimed" if asked.targets else "random_joint": 1.0}
        if robot.floating:
            mix = usual_mix(robot, aimed=bool(asked.targets))
        proposals = plan_proposals(
            robot, asked.count, np.random.SeedSequence(seed), mix=mix, targets=asked.targets
        )
        kept = filter_candidates(
            robot, proposals, jobs=asked.jobs, total=asked.count, robust=asked.robust
        ).motions
        if not kept:
            raise NoSolutionError(
                f"no random motion of {robot.name} is safe, from which one could be designed",
                remedy="ask for more candidates",
            )
        rows = design_rows(robot, members, filtered_noise(robot, kept))
        known = first_information(rows, kept) + sum(map(rows.of_motion, asked.before))
        criterion = _criterion(rows, asked)
        sets, others = sets_within(kept, asked.budget_s), list[Motion]()
        if robot.floating and asked.budget_s is not None:
            designed = chosen_sources(rows, kept, known, criterion, asked.budget_s)
            left = [one for one in kept if one not in designed] or designed
            sets, others = [designed], chosen_sources(rows, left, known, criterion, asked.budget_s)
        shared = Shared((rows, known, criterion, asked.robust))
        made: list[Motion] = []
        for designs in in_order(_design, sets, jobs=asked.jobs, shared=shared, stage="design"):
            made += [
                # What no step made safe is its source still, and is called so.
                one.motion.renamed(f"{one.motion.metadata.generator}_{len(made) + i:03d}")
                for i, one in enumerate(designs)
            ]
            asked.progress("design", len(made), sum(map(len, sets)))
        names = {one.name for one in made}
        return made + [one for one in others if one.name not in names]


def chosen_sources(
    rows: DesignRows, sources: Sequence[Motion], known: Array, criterion: Criterion, budget_s: float
) -> list[Motion]:
    """Those of several motions that say most together within a time at the robot, the shortest where none fits."""
    single = np.array([rows.of_motion(motion) for motion in sources])
    durations = np.array([motion.duration for motion in sources])
    chosen = greedy_choice(Information(single, np.eye(len(known)), known), criterion, durations, budget_s)
    return [sources[i] for i in chosen or [int(np.argmin(durations))]]


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
    if not asked.parameters and not (rows.robot.floating and asked.budget_s is not None):
        return LogDeterminant()
    rows_hz = ProblemSettings().filters(floating=rows.robot.floating).rate_hz
    return ReachedTargets.of(
        rows.robot, rows.base, asked.parameters, target_rsd=asked.target_rsd, rows=SEARCH_HZ / rows_hz
    )


def _design(shared: tuple[DesignRows, Array, Criterion, bool], sources: list[Motion]) -> list[Design]:
    rows, start, criterion, robust = shared

    def stands(motion: Motion) -> bool:
        return rehearse_motions(rows.robot, [motion]) == (None,)

    return design_motions(rows, sources, start, criterion, robust=robust, stands=stands)
