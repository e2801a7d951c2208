"""The candidates of a plan by the name of who makes them: a generator, a search, or the robot's mixture."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from excite.campaign.candidates.registry import SEARCHES
from excite.campaign.candidates.search import Asked
from excite.errors import UnknownNameError
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.generator import child_seed
from excite.motion.generators.mixture import plan_proposals
from excite.motion.generators.proposal import Proposal
from excite.motion.generators.registry import GENERATORS


@dataclass(frozen=True, eq=False)
class Source:
    """Candidates, or proposals that are drawn later.

    Attributes:
        candidates: each once.
        count: how many there are.
    """

    candidates: Iterable[Candidate | Proposal]
    count: int


def check_generator(name: str | None) -> None:
    """Raise UnknownNameError for a name that neither a generator nor a search has; None is the robot's mixture."""
    known = [*GENERATORS, *SEARCHES]
    if name is not None and name not in known:
        raise UnknownNameError("generator", name, sorted(known))


def candidates_of(generator: str | None, asked: Asked, seed: np.random.SeedSequence, turn: int = 0) -> Source:
    """The candidates that a generator, a search or (None) the robot's mixture of generators makes of a seed.

    In a later ``turn`` these are as many more, as if all had been asked for at once; a search has only the first.

    Raises:
        UnknownNameError: a target is no joint of the robot.
        RobotError: the generator does not apply to the robot.
        NoSolutionError: a search found nothing.
        InputError: a search does not suit the robot, a target or a setting.
    """
    if generator is not None and generator in SEARCHES:
        found = SEARCHES.make(generator).candidates(asked, child_seed(seed, 0))
        return Source(found, len(found))
    mix = None if generator is None else {generator: 1.0}
    before = turn * asked.count
    proposals = plan_proposals(
        asked.robot, before + asked.count, seed, mix=mix, targets=asked.targets, beyond=before
    )
    return Source(proposals, asked.count)
