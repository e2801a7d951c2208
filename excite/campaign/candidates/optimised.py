"""Candidates from the optimiser: each start of its search is a candidate, repaired and judged like all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.campaign.candidates.search import Asked, CandidateSearch
from excite.campaign.candidates.series import HARMONICS, SeriesSettings
from excite.errors import InputError, NoSolutionError
from excite.excitation.optimisation.family import FourierFamily
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.sampling import NAME
from excite.excitation.optimisation.search import OptimisedMotion, SearchSettings, optimise_excitation
from excite.excitation.optimisation.task import ExcitationTask
from excite.motion.generators.bodyparts import central_range, free_upper_body, rest_joints
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.robot.robot import Robot
from excite.safety.repairs.shares import Shares

# Share of a joint's range that stays on either side of where it rests.
_ROOM_AT_REST = 0.02
# Period of the series [s]: the slowest joint's range takes one, within these bounds.
_PERIODS = (6.0, 20.0)


# Share of their range that the other joints use where some are aimed at: the middle of what random candidates use.
_OTHERS = 0.4


class OptimisedSeries(CandidateSearch):
    """Optimised Fourier series within the share of the limits that repairs leave alone.

    Of an arm, or of a robot whose upper body moves while its base stands still. Starts that end in no safe motion are
    left out. Joints that are aimed at have each their share of the starts: one has the whole of its range, the
    others a part of theirs about where they rest.
    """

    name = NAME

    def candidates(self, asked: Asked, seed: int) -> list[Candidate]:
        """See :class:`~excite.campaign.candidates.search.CandidateSearch`; one candidate a start.

        Raises:
            NoSolutionError: limits leave no room, or no start ended in a safe motion.
            UnknownNameError: a target is no joint of the robot.
            InputError: a target stands still in these series; the criterion needs noise that the robot does not state.
        """
        return _optimise_candidates(asked, seed)


def _optimise_candidates(asked: Asked, seed: int) -> list[Candidate]:
    robot, count, targets = asked.robot, asked.count, asked.targets
    settings = asked.series or SeriesSettings()
    settings.fit(robot)
    moved = free_upper_body(robot)
    for joint in targets:
        if not moved[robot.joint_index(joint)]:
            raise InputError(
                f"joint {joint!r} stands still in optimised series",
                source=robot.name,
                remedy="aim at a joint of the upper body that carries no foot, or use another generator",
            )
    aims: list[str | None] = [*targets[:count]] or [None]
    made: list[Candidate] = []
    failed: NoSolutionError | None = None
    for place, aim in enumerate(aims):
        starts = len(range(place, count, len(aims)))
        search = SearchSettings(starts=starts, kicks=1, seed=seed + place)
        try:
            found = optimise_excitation(
                _excitation_task(robot, aim, settings), search, jobs=asked.jobs, progress=asked.progress
            ).found
        except NoSolutionError as error:
            # Other targets may have more room.
            failed = error
            continue
        made += [_build_candidate(robot, item, aim, seed + place) for item in found]
    if failed is not None and not made:
        raise failed
    return [replace(candidate, name=f"{NAME}_{i:03d}") for i, candidate in enumerate(made)]


def _excitation_task(robot: Robot, aim: str | None, settings: SeriesSettings) -> ExcitationTask:
    lower, upper = central_range(robot)
    own, shares = robot.limits, Shares()
    if robot.feet:
        # A standing robot starts at rest, which may be outside the central range.
        away = _ROOM_AT_REST * (own.position_upper - own.position_lower)
        rest = rest_joints(robot)
        lower = np.minimum(lower, np.maximum(own.position_lower, rest - away))
        upper = np.maximum(upper, np.minimum(own.position_upper, rest + away))
    velocity = shares.velocity * own.velocity
    moved = free_upper_body(robot)
    period = settings.period_s
    if period is None:
        period = float(np.clip(np.pi * ((upper - lower) / velocity)[moved].max(), *_PERIODS))
    if aim is not None:
        rest = np.clip(rest_joints(robot), lower, upper)
        share = np.full(robot.n_joints, _OTHERS)
        share[robot.joint_index(aim)] = 1.0
        lower, upper = rest + share * (lower - rest), rest + share * (upper - rest)
    limits = JointLimits(
        lower=lower,
        upper=upper,
        velocity=velocity,
        acceleration=shares.acceleration * own.acceleration,
        torque=shares.torque * own.torque,
    )
    return ExcitationTask(robot, FourierFamily(period, HARMONICS), settings.criterion, limits)


def _build_candidate(robot: Robot, item: OptimisedMotion, aim: str | None, seed: int) -> Candidate:
    feet = tuple(foot.name for foot in robot.feet)
    return Candidate(
        name=item.motion.name,
        generator=NAME,
        targets=item.motion.metadata.targets if aim is None else (aim,),
        seed=seed,
        posture=item.curve,
        speed=1.0,
        phases=(SupportPhase(0.0, item.curve.length, feet),) if feet else (),
    )
