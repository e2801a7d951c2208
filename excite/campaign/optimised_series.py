"""Optimised series as candidates: what is asked for, and the search that finds all of a plan's candidates together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.campaign.expected import TARGET_RSD
from excite.errors import NoSolutionError
from excite.excitation.series import ExcitationTask, check_criterion, fourier_family
from excite.excitation.series_search import NAME, OptimisedMotion, SearchSettings, optimise_excitation
from excite.formats.number import check_number
from excite.motion.generators.generator import Candidate, central_range, rest_joints
from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot
from excite.safety.repairs.rows import Shares

# What optimised series are to be: their criterion and their period.

HARMONICS = 5


# What no robot's rate allows [s].
_ANY_PERIOD = (1e-6, 1e6)


# Numbers of a motion, positions, velocities and accelerations at the robot's rate: 16 MB. Each start samples,
# differentiates and checks all of it some hundred times; an arm at 1 kHz gets a minute and a half.
_MOST_NUMBERS = 2_000_000


@dataclass(frozen=True)
class SeriesSettings:
    """What a plan's optimised series are to be.

    Attributes:
        criterion: ``condition``, ``log_det`` or ``largest_rsd``.
        period_s: of the series [s]; what the slowest joint needs for its range, from 6 to 20 s, if None.
    """

    criterion: str = "condition"
    period_s: float | None = None

    def __post_init__(self) -> None:
        """Check the bounds; raises UnknownNameError or InputError."""
        check_criterion(self.criterion)
        if self.period_s is not None:
            check_number(self.period_s, "period", *_ANY_PERIOD, "s")

    def fit(self, robot: Robot) -> None:
        """Raise InputError where the robot's rate makes too few samples of a period, or more than memory holds."""
        if self.period_s is None:
            return
        rate = robot.description.sensors.rate_hz
        shortest, longest = (
            2.0 * HARMONICS / rate,
            _MOST_NUMBERS / (rate * (robot.model.nq + 2 * robot.model.nv)),
        )
        check_number(self.period_s, "period", shortest, longest, "s", source=robot.name)


# What a search for candidates is: all of a plan's found together, where a generator draws each on its own.


@dataclass(frozen=True, eq=False)
class Asked:
    """What candidates are asked for.

    Attributes:
        robot: the robot.
        count: how many to try; what cannot be made safe may be left out.
        targets: joints to aim at; all, if empty.
        series: criterion and period of optimised series; None for the defaults.
        jobs: number of processes, or an executor; the candidates do not depend on it.
        progress: told as work proceeds.
        robust: whether limits shall hold for all robots of the set that the description states.
        budget_s: time at the robot that motions are chosen for [s]; None where nobody says.
        parameters: that are asked for in it, such as ``forearm_link:com``; all, if empty.
        target_rsd: relative standard deviation to reach with them [percent].
        before: motions that were run already, whose information counts.
    """

    robot: Robot
    count: int
    targets: Sequence[str] = ()
    series: SeriesSettings | None = None
    jobs: Jobs = 1
    progress: Progress = silent
    robust: bool = False
    budget_s: float | None = None
    parameters: Sequence[str] = ()
    target_rsd: float = TARGET_RSD
    before: Sequence[Motion] = ()


class CandidateSearch(ABC):
    """Finds candidates together. A new one is one file beside this one and its line in ``SEARCHES``.

    Attributes:
        name: what users type after ``--generator``, beside the names of generators.
    """

    name: ClassVar[str]

    def usual_count(self, robot: Robot) -> int | None:
        """How many candidates it tries where nobody says; as many as of generators, if None."""
        return None

    @abstractmethod
    def candidates(self, asked: Asked, seed: int) -> Sequence[Candidate | Motion]:
        """The candidates of one seed, or motions that need no repair.

        Raises:
            NoSolutionError: there are none.
            InputError: the robot, a target or a setting does not suit it.
        """


# Candidates from the optimiser: each start of its search is a candidate, repaired and judged like all others.

# Period of the series [s]: the slowest joint's range takes one, within these bounds.
_PERIODS = (6.0, 20.0)


# Share of their range that the other joints use where some are aimed at: the middle of what random candidates use.
_OTHERS = 0.4


class OptimisedSeries(CandidateSearch):
    """Optimised Fourier series within the share of the limits that repairs leave alone.

    Of an arm; of a standing robot ``gradient`` designs motions. Starts that end in no safe motion are left out. Joints
    that are aimed at have each their share of the starts: one has the whole of its range, the others a part of theirs
    about where they rest.
    """

    name = NAME

    def candidates(self, asked: Asked, seed: int) -> list[Candidate]:
        """See :class:`~excite.campaign.optimised_series.CandidateSearch`; one candidate a start.

        Raises:
            NoSolutionError: limits leave no room, or no start ended in a safe motion.
            UnknownNameError: a target is no joint of the robot.
            InputError: no arm with a motor in every joint; the criterion needs noise that the robot does not state.
        """
        robot, count, targets = asked.robot, asked.count, asked.targets
        settings = asked.series or SeriesSettings()
        settings.fit(robot)
        for joint in targets:
            robot.joint_index(joint)
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
            made += [_build_candidate(item, aim, seed + place) for item in found]
        if failed is not None and not made:
            raise failed
        return [replace(candidate, name=f"{NAME}_{i:03d}") for i, candidate in enumerate(made)]


def _excitation_task(robot: Robot, aim: str | None, settings: SeriesSettings) -> ExcitationTask:
    limits = usual_limits(robot)
    period = settings.period_s
    if period is None:
        span = (limits.position_upper - limits.position_lower) / limits.velocity
        period = float(np.clip(np.pi * span.max(), *_PERIODS))
    if aim is not None:
        lower, upper = limits.position_lower, limits.position_upper
        rest = np.clip(rest_joints(robot), lower, upper)
        share = np.full(robot.n_joints, _OTHERS)
        share[robot.joint_index(aim)] = 1.0
        limits = replace(
            limits,
            position_lower=rest + share * (lower - rest),
            position_upper=rest + share * (upper - rest),
        )
    return ExcitationTask(robot, fourier_family(period, HARMONICS), settings.criterion, limits)


def usual_limits(robot: Robot) -> Limits:
    """The middle of the joints' ranges, and the shares of their other limits that repairs leave alone."""
    lower, upper = central_range(robot)
    own, shares = robot.limits, Shares()
    return replace(
        own,
        position_lower=lower,
        position_upper=upper,
        velocity=shares.velocity * own.velocity,
        acceleration=shares.acceleration * own.acceleration,
        torque=shares.torque * own.torque,
    )


def _build_candidate(item: OptimisedMotion, aim: str | None, seed: int) -> Candidate:
    targets = item.motion.metadata.targets if aim is None else (aim,)
    return Candidate(item.motion.name, NAME, targets, seed, item.curve, speed=1.0)
