"""The safety filter: repairs in order, then the independent verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sized
from dataclasses import replace
from functools import lru_cache
from typing import Any

from excite.motion.content import with_verdict
from excite.motion.generators.generator import Candidate, Proposal
from excite.motion.generators.mixture import draw_candidate
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model
from excite.safety.check import check_motion
from excite.safety.filter_report import FilterOutcome, FilterReport, count_outcomes
from excite.safety.parameter_set import stated_parameters
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.retiming import Retiming
from excite.safety.repairs.rows import Shares
from excite.safety.repairs.sampling import Sampling
from excite.safety.repairs.time_scaling import TimeScaling
from excite.safety.repairs.waypoints import Waypoints
from excite.safety.repairs.whole_body import WholeBody
from excite.safety.verdict import Verdict

# What a caller makes of an accepted motion, in the process that made it; has to be picklable, and so has the answer.
Keep = Callable[[Robot, Motion], Any]


class SafetyFilter:
    """Repairs and verdict of one robot, kept ready because they are dear to build."""

    def __init__(self, robot: Robot, *, robust: bool = False) -> None:
        self._robot, self._robust = robot, robust
        shares = Shares(robots=stated_parameters(robot)) if robust else Shares()
        self._repairs = make_repairs(robot, shares)

    def filter(self, asked: Filtered) -> FilterOutcome:
        """Repair a candidate, which a proposal is drawn to be, and judge the motion that results; a motion is judged
        as it is."""
        start = time.process_time()
        made = draw_candidate(self._robot, asked) if isinstance(asked, Proposal) else asked
        if isinstance(made, Candidate):
            repaired = self._repair(made)
            if isinstance(repaired, Rejection):
                return FilterOutcome(made.name, time.process_time() - start, rejection=repaired)
            made = repaired
        verdict = check_motion(self._robot, made, robust=self._robust)
        return FilterOutcome(
            candidate=made.name,
            seconds=time.process_time() - start,
            motion=with_verdict(made, verdict.to_json(), self._robot.hash) if verdict.safe else None,
            verdict=verdict,
            rejection=_rejection_of(made.name, verdict),
        )

    def _repair(self, candidate: Candidate) -> Motion | Rejection:
        draft = Draft(candidate)
        for repair in self._repairs:
            repaired = repair.repair(draft)
            if isinstance(repaired, Rejection):
                return repaired
            draft = repaired
        return draft.rejected("no_motion", "repairs") if draft.motion is None else draft.motion


# What the filter takes: a proposal is drawn first; a motion, whose maker has kept the limits, is judged as it is.
Filtered = Candidate | Proposal | Motion


def filter_candidate(robot: Robot, candidate: Filtered, *, robust: bool = False) -> FilterOutcome:
    """Make one candidate safe, or say why that failed.

    Args:
        robot: the robot.
        candidate: the candidate, or what one may be in place of it.
        robust: whether torque, zero-moment point and friction shall hold for all robots of the set that the
            description states.

    Returns:
        The motion and its verdict, or the rejection. Repairs never judge: a motion is accepted only if the
        independent check finds it safe.

    Raises:
        RobotError: the robot's collision geometry cannot be read.
    """
    return _filter_of(robot, robust).filter(candidate)


def filter_candidates(
    robot: Robot,
    candidates: Iterable[Filtered],
    *,
    jobs: Jobs = 1,
    total: int | None = None,
    progress: Progress = silent,
    keep: Keep | None = None,
    partial: bool = False,
    robust: bool = False,
) -> FilterReport:
    """Make candidates safe, in several processes.

    Args:
        robot: the robot.
        candidates: candidates, or proposals, which are drawn where they are judged, or motions; read as work proceeds.
        jobs: number of processes, or an executor. The outcomes do not depend on it.
        total: how many candidates, where they do not say.
        progress: told after each candidate, stage ``filter``.
        keep: called with the robot and each accepted motion where that was made; its answer stands in the report
            in place of all outcomes, so that memory need not grow with the number of candidates.
        partial: where the user interrupts, report what was judged by then instead of passing the interrupt on.
        robust: as of :func:`filter_candidate`.

    Returns:
        What became of the candidates, in their order.

    Raises:
        InputError: ``jobs`` is not what it may be.
        RobotError: the robot's collision geometry cannot be read.
    """
    if total is None and isinstance(candidates, Sized):
        total = len(candidates)
    if jobs != 1:
        # Broken geometry shall raise here, before it is read by every worker.
        collision_model(robot)
    outcomes = in_order(
        _filter_one,
        candidates,
        jobs=jobs,
        shared=(robot, keep, robust),
        total=total,
        stage="filter",
        progress=progress,
    )
    return count_outcomes(robot, outcomes, whole=keep is None, partial=partial)


@lru_cache(maxsize=4)
def _filter_of(robot: Robot, robust: bool) -> SafetyFilter:
    return SafetyFilter(robot, robust=robust)


def _rejection_of(name: str, verdict: Verdict) -> Rejection | None:
    """The rejection that a verdict means; reasons from the check start with ``check_``."""
    if verdict.safe:
        return None
    if verdict.violations:
        first = verdict.violations[0]
        return Rejection(name, f"check_{first.kind}", first.where, first.time_s, first.value, first.limit)
    return Rejection(name, "check_not_computed", ", ".join(verdict.not_computed))


def _filter_one(shared: tuple[Robot, Keep | None, bool], candidate: Filtered) -> FilterOutcome:
    robot, keep, robust = shared
    outcome = filter_candidate(robot, candidate, robust=robust)
    if keep is None or outcome.motion is None:
        return outcome
    return replace(outcome, motion=None, kept=keep(robot, outcome.motion))


# All repairs, in the order in which they run: cheap rejections first. A new one is one file and its line
# here.

REPAIRS: dict[str, type[Repair]] = {
    repair.name: repair
    for repair in (
        Waypoints,
        WholeBody,
        Retiming,
        TimeScaling,
        Sampling,
    )
}


def make_repairs(robot: Robot, shares: Shares | None = None) -> list[Repair]:
    """One of each, ready for a robot.

    Args:
        robot: the robot.
        shares: how much of each limit to use; the default leaves the verdict a margin.
    """
    probe, shares = CollisionProbe(robot), shares or Shares()
    return [repair(robot, probe, shares) for repair in REPAIRS.values()]
