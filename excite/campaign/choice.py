"""The choice of a plan's motions: by a rule, rehearsed, and chosen again without those that fell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from excite.campaign.on_disk import OnDisk, write_value
from excite.campaign.pool import Pool
from excite.campaign.rehearsal import LEAST_LOAD, UNKNOWN_LOAD, can_fall, rehearse_motions
from excite.errors import NoSolutionError
from excite.excitation.conditioning import MotionFactor, motion_factor
from excite.excitation.precision import row_noise
from excite.excitation.selection import Candidates, Selection, select_motions
from excite.parallel.jobs import Jobs
from excite.progress import Progress
from excite.regressor.base_parameters import BaseParameters
from excite.robot.legs.upright import too_soft_to_stand
from excite.robot.robot import Robot
from excite.safety.refusals import tally_refusals
from excite.safety.repairs.draft import Rejection

# Motions kept back for cross-validation.
_N_VALIDATION = 4


@dataclass(frozen=True)
class Rule:
    """How motions are chosen.

    Attributes:
        name: in ``SELECTIONS``.
        budget_s: total duration that a greedy choice stays within [s]; as long as the best three take, if None.
        limits: by segment, the condition number that is good enough, for the choice by ``segments``.
    """

    name: str
    budget_s: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Choice:
    """Motions that were chosen and rehearsed: indices are those of the pool.

    Attributes:
        pool: the motions that did not fall.
        selection: which of them go on.
        validation: which of the others judge the result.
        fallen: what went wrong with those that did not stand their rehearsal.
        load: that the robot carried in the rehearsal, of its mass; None of a robot that cannot fall, and where the
            user broke off before it.
        interrupted: whether the user broke off: a robot that can fall has not rehearsed them.
    """

    pool: Pool
    selection: Selection
    validation: tuple[int, ...]
    fallen: tuple[Rejection, ...]
    load: float | None
    interrupted: bool = False


@dataclass(frozen=True)
class Rehearsed:
    """What became of motions in rehearsal, by name and load, so that none is rehearsed twice."""

    found: dict[tuple[str, float], Rejection | None] = field(default_factory=dict)

    def fallen(self, pool: Pool, load: float) -> dict[str, Rejection]:
        """What went wrong with motions of a pool under a load, by name."""
        known = {name: self.found.get((name, load)) for name in pool.names}
        return {name: refused for name, refused in known.items() if refused is not None}


def choose_motions(
    robot: Robot,
    pool: Pool,
    base: BaseParameters,
    rule: Rule,
    jobs: Jobs,
    progress: Progress,
    rehearsed: Rehearsed | None = None,
    *,
    interrupted: bool = False,
) -> Choice:
    """Choose motions by a rule, rehearse them, and choose again without those that fell; raises NoSolutionError.

    Where all of them fall under the load that a robot should carry, they are rehearsed with the least. What is known
    from rehearsals before stands in ``rehearsed``, and what these tell is added. Where the user broke off already, or
    does now, they are chosen without a rehearsal, and without those of which it is known that they fall.
    """
    known = rehearsed or Rehearsed()
    load = UNKNOWN_LOAD
    try:
        if not interrupted:
            try:
                return _choose_and_rehearse(robot, pool, base, rule, load, jobs, progress, known)
            except _AllFall:
                load = LEAST_LOAD
                return _choose_and_rehearse(robot, pool, base, rule, load, jobs, progress, known)
    except KeyboardInterrupt:
        pass
    fallen = known.fallen(pool, load)
    left = pool.without(set(fallen))
    selection = _apply_rule(robot, left, base, rule)
    validation = _unchosen_in_turn(left, selection.indices)
    return Choice(left, selection, validation, tuple(fallen.values()), None, interrupted=True)


class _AllFall(NoSolutionError):
    """No motion stands its rehearsal."""


def _choose_and_rehearse(
    robot: Robot,
    pool: Pool,
    base: BaseParameters,
    rule: Rule,
    load: float,
    jobs: Jobs,
    progress: Progress,
    known: Rehearsed,
) -> Choice:
    while True:
        fallen = known.fallen(pool, load)
        left = pool.without(set(fallen))
        if fallen and not left.entries:
            raise _AllFall(
                f"all {len(fallen)} safe motions of {robot.name} fall or slip in rehearsal, with {load:.0%} of its "
                f"mass on its back: {tally_refusals(robot, fallen.values())[0].sentence}",
                best=left.motions,
                remedy=too_soft_to_stand(robot) or "ask for more candidates, or for calmer motions",
            )
        selection = _apply_rule(robot, left, base, rule)
        validation = _unchosen_in_turn(left, selection.indices)
        names = left.names
        new = [i for i in (*selection.indices, *validation) if (names[i], load) not in known.found]
        if not new:
            carried = load if can_fall(robot) else None
            return Choice(left, selection, validation, tuple(fallen.values()), carried)
        outcomes = rehearse_motions(robot, left.motions.only(new), load=load, jobs=jobs, progress=progress)
        for i, refused in zip(new, outcomes, strict=True):
            known.found[names[i], load] = refused


def _apply_rule(robot: Robot, left: Pool, base: BaseParameters, rule: Rule) -> Selection:
    """What a rule selects; raises NoSolutionError where that is nothing."""
    selection = (
        select_motions(rule.name, selection_candidates(robot, left, base, rule)) if left.entries else None
    )
    if selection is None or not selection.indices:
        raise NoSolutionError(
            f"none of the {len(left.entries)} safe motions excites any segment of {robot.name} to full rank",
            best=left.motions,
            remedy="ask for more candidates",
        )
    return selection


def selection_candidates(
    robot: Robot, pool: Pool, base: BaseParameters, rule: Rule | None = None
) -> Candidates:
    """What a rule of selection chooses from, within its bounds."""

    def weighted() -> OnDisk[MotionFactor]:
        noise, motions = row_noise(robot), pool.motions
        files = tuple(pool.folder.path / f"{name}.weighted" for name in pool.names)
        for index, path in enumerate(files):
            # A choice without those that fell finds the others' there.
            if not path.exists():
                write_value(motion_factor(robot, motions[index], row_std=noise), path)
        return OnDisk(files, pool.folder)

    return Candidates(
        robot=robot,
        ranking=pool.ranking,
        factors=pool.factors,
        durations=pool.durations,
        base=base,
        weighted=weighted,
        budget_s=None if rule is None else rule.budget_s,
        limits={} if rule is None else rule.limits,
    )


def _unchosen_in_turn(pool: Pool, chosen: Sequence[int], count: int = _N_VALIDATION) -> tuple[int, ...]:
    """Up to ``count`` motions that were not chosen, generators taken in turn."""
    left = [i for i in pool.in_turn() if i not in set(chosen)]
    return tuple(sorted(left[:count]))
