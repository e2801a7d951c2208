"""The choice of a plan's motions: by a rule, rehearsed, and chosen again without those that fell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.campaign.rehearsal import rehearse
from excite.errors import NoSolutionError
from excite.excitation.conditioning import MotionFactor, motion_factor
from excite.excitation.precision import row_noise
from excite.excitation.ranking import rank
from excite.excitation.selection import Candidates, Selection, select
from excite.motion.motion import Motion
from excite.progress import Progress
from excite.regressor.base_parameters import BaseParameters
from excite.robot.robot import Robot

# Motions kept back for cross-validation.
_N_VALIDATION = 4


@dataclass(frozen=True, eq=False)
class Pool:
    """Motions to choose from, and the R factor of each."""

    motions: tuple[Motion, ...]
    factors: tuple[MotionFactor, ...]

    def without(self, fallen: set[str]) -> Pool:
        """The pool without motions of these names."""
        kept = [i for i, motion in enumerate(self.motions) if motion.name not in fallen]
        return Pool(tuple(self.motions[i] for i in kept), tuple(self.factors[i] for i in kept))


@dataclass(frozen=True, eq=False)
class Choice:
    """Motions that were chosen and rehearsed: indices are those of the pool."""

    pool: Pool
    selection: Selection
    validation: tuple[int, ...]
    fallen: int


def choose(
    robot: Robot, pool: Pool, base: BaseParameters, rule: str, jobs: int, progress: Progress
) -> Choice:
    """Choose motions by a rule, rehearse them, and choose again without those that fell; raises NoSolutionError."""
    fallen: set[str] = set()
    stood: set[str] = set()
    while True:
        left = pool.without(fallen)
        selection = select(rule, candidates(robot, left, base)) if left.motions else None
        if selection is None or not selection.indices:
            raise NoSolutionError(
                f"none of the {len(left.motions)} safe motions excites any segment of {robot.name} to full rank",
                best=left.motions,
                remedy="ask for more candidates",
            )
        validation = _unchosen_in_turn(left.motions, selection.indices)
        new = [
            left.motions[i] for i in (*selection.indices, *validation) if left.motions[i].name not in stood
        ]
        if not new:
            return Choice(left, selection, validation, len(fallen))
        verdicts = rehearse(robot, new, jobs=jobs, progress=progress)
        for motion, stands in zip(new, verdicts, strict=True):
            (stood if stands else fallen).add(motion.name)


def candidates(robot: Robot, pool: Pool, base: BaseParameters) -> Candidates:
    """What a rule of selection chooses from."""

    def weighted() -> tuple[MotionFactor, ...]:
        noise = row_noise(robot)
        return tuple(motion_factor(robot, motion, row_std=noise) for motion in pool.motions)

    return Candidates(
        robot=robot,
        ranking=rank(robot, pool.factors, base),
        factors=pool.factors,
        durations=np.array([motion.duration for motion in pool.motions]),
        base=base,
        weighted=weighted,
    )


def _unchosen_in_turn(
    motions: Sequence[Motion], chosen: Sequence[int], count: int = _N_VALIDATION
) -> tuple[int, ...]:
    """Up to ``count`` motions that were not chosen, generators taken in turn."""
    left = [i for i in _in_turn(motions) if i not in set(chosen)]
    return tuple(sorted(left[:count]))


def first_seconds(motions: Sequence[Motion], seconds: float) -> list[int]:
    """The first motions whose durations add up to at least ``seconds``, generators taken in turn."""
    taken: list[int] = []
    for index in _in_turn(motions):
        if sum(motions[i].duration for i in taken) >= seconds:
            break
        taken.append(index)
    return sorted(taken)


def _in_turn(motions: Sequence[Motion]) -> list[int]:
    """Indices of motions with their generators taken in turn."""
    place: dict[str, int] = {}
    keys = []
    for index, motion in enumerate(motions):
        generator = motion.metadata.generator
        place[generator] = place.get(generator, 0) + 1
        keys.append((place[generator], index))
    return [index for _, index in sorted(keys)]
