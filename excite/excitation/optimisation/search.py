"""The search over several starts, in parallel, which always ends in a motion that was found safe, or says why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, NoSolutionError
from excite.excitation.optimisation.chain import Chain, Point
from excite.excitation.optimisation.sampling import NAME, sample_curve, whole_curve
from excite.excitation.optimisation.task import ExcitationTask
from excite.motion.generators.curves import Curve
from excite.motion.generators.generator import child_seed
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs, at_once, check_jobs
from excite.parallel.worker import Shared
from excite.progress import Progress, silent
from excite.safety.check import check_motion
from excite.safety.verdict import Verdict

# A motion that just misses its limits or collides between samples is made smaller in steps, down to this share.
_SMALLER, _SMALLEST = 0.98, 0.5


@dataclass(frozen=True)
class SearchSettings:
    """How hard to search; the result depends on these and the seed, and on nothing else.

    Attributes:
        starts: independent starts.
        kicks: times that each start's best is kicked and solved anew.
        effort: factor on the iterations of every solve.
        seed: of all random numbers.
    """

    starts: int = 4
    kicks: int = 3
    effort: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the bounds; raises InputError naming the setting."""
        if self.starts < 1:
            raise InputError(f"is {self.starts}", field="starts", remedy="give at least 1")
        if not 0.0 < self.effort < np.inf:
            raise InputError(f"is {self.effort}", field="effort", remedy="give a positive number")
        if self.kicks < 0 or self.seed < 0:
            raise InputError(
                "is negative", field="kicks" if self.kicks < 0 else "seed", remedy="give 0 or more"
            )


@dataclass(frozen=True, eq=False)
class OptimisedMotion:
    """One start's end.

    Attributes:
        start: number of the start.
        curve: of the moved joints and the others, all ``n_joints``.
        motion: the same as samples at the robot's rate.
        value: the criterion, finely sampled; for conditions the condition number.
        verdict: of the independent check.
        evaluations: of objective and gradient.
    """

    start: int
    curve: Curve
    motion: Motion
    value: float
    verdict: Verdict
    evaluations: int


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What the search found.

    Attributes:
        found: safe motions, the best first.
        refused: by reason, how many starts ended in none.
        n_base: number of base parameters.
        interrupted: whether the user broke off; the motions are then the best until then.
        values: best criterion of each start after each round, ``(n_rounds, starts)``, smoothed, as logarithm.
    """

    found: tuple[OptimisedMotion, ...]
    refused: dict[str, int]
    n_base: int
    interrupted: bool
    values: Array = field(repr=False)

    @property
    def best(self) -> OptimisedMotion:
        """The best motion."""
        return self.found[0]


def optimise_excitation(
    task: ExcitationTask,
    settings: SearchSettings | None = None,
    *,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> SearchResult:
    """Search for the best motion of a task.

    Several starts; each draws random motions within the limits, solves the program from the best of them, kicks
    the solution and solves anew, and solves a last time on a finer grid. What comes out is scaled into its limits
    exactly and judged by the independent check; what that refuses is made smaller until it passes.

    Args:
        task: what to optimise.
        settings: how hard to search.
        jobs: number of processes, or an executor; the result does not depend on it.
        progress: told after each solve, stage ``optimise_excitation``.

    Returns:
        The safe motions. Ctrl-C ends the search with the best until then.

    Raises:
        NoSolutionError: limits leave no room, or no start ended in a safe motion; the error counts the reasons.
        InputError: settings, noise or columns do not fit.
    """
    settings = settings or SearchSettings()
    check_jobs(jobs)
    if task.robot.mechanism is not None:
        raise InputError(
            "has joints that no motor drives, for which the search has no gradients",
            source=task.robot.source,
            field="loops" if task.robot.description.loops else "couplings",
            remedy="choose from candidates: leave the optimisation out",
        )
    chain = Chain(task, settings.effort)
    shared = Shared(chain)
    points: list[Point | None] = [None] * settings.starts
    history: list[list[float]] = []
    interrupted = False
    rounds, done = settings.kicks + 2, 0
    try:
        for number in range(rounds):
            steps = [
                _Step(point, number, rounds, child_seed(_root_seed(settings), index * rounds + number))
                for index, point in enumerate(points)
            ]
            solved = in_order(_run_step, steps, jobs=at_once(jobs), shared=shared, stage="optimise")
            for index, point in enumerate(solved):
                points[index] = point
                done += 1
                progress("optimise", done, rounds * settings.starts)
            history.append([np.inf if point is None else point.value for point in points])
    except KeyboardInterrupt:
        interrupted = True
        if not any(point is not None for point in points):
            raise
    return _build_result(chain, points, interrupted, history)


def _root_seed(settings: SearchSettings) -> np.random.SeedSequence:
    return np.random.SeedSequence(settings.seed)


@dataclass(frozen=True, eq=False)
class _Step:
    """One round of one start."""

    point: Point | None
    number: int
    rounds: int
    seed: int


def _run_step(chain: Chain, step: _Step) -> Point:
    rng = np.random.default_rng(step.seed)
    if step.point is None:
        return chain.begin(rng)
    return chain.finish(step.point) if step.number == step.rounds - 1 else chain.kick(step.point, rng)


def _build_result(
    chain: Chain, points: Sequence[Point | None], interrupted: bool, history: list[list[float]]
) -> SearchResult:
    found: list[OptimisedMotion] = []
    refused: Counter[str] = Counter()
    for index, point in enumerate(points):
        if point is None:
            continue
        outcome = _made_safe(chain, index, point)
        if isinstance(outcome, OptimisedMotion):
            found.append(outcome)
        else:
            refused[outcome] += 1
    if not found:
        reasons = ", ".join(f"{count} {reason}" for reason, count in refused.items())
        raise NoSolutionError(
            f"none of {len(points)} starts ends in a safe motion of {chain.task.robot.name} ({reasons})",
            remedy="give more room to the joints, more starts, or another rest posture",
        )
    found.sort(key=lambda motion: (motion.value, motion.start))
    return SearchResult(tuple(found), dict(refused), chain.n_base, interrupted, np.array(history))


def _made_safe(chain: Chain, index: int, point: Point) -> OptimisedMotion | str:
    """A start's end, scaled into its limits and made smaller until it is safe; or the reason why it is not."""
    x = chain.scaled(point.x, 1.0 / np.maximum(chain.shares(point.x), 1.0))
    share, reason = 1.0, "no_motion"
    while share >= _SMALLEST:
        smaller = chain.scaled(x, share)
        curve = whole_curve(chain, smaller)
        motion = sample_curve(chain.task.robot, curve, f"{NAME}_{index:03d}", index)
        verdict = check_motion(chain.task.robot, motion)
        violations = [item for item in verdict.violations if violation_counts(chain.task, item.kind)]
        if not violations:
            return OptimisedMotion(index, curve, motion, chain.value(smaller), verdict, point.evaluations)
        reason, share = violations[0].kind, share * _SMALLER
    return reason


def violation_counts(task: ExcitationTask, kind: str) -> bool:
    """Whether a violation of that kind matters: collisions only where they are to be avoided."""
    return task.avoid_collisions or kind != "self_collision"
