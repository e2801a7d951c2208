"""The verb ``plan``: generate, filter, rank, choose."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from excite.campaign.candidates.judged import ENOUGH, N_CANDIDATES, TURNS, Judged
from excite.campaign.candidates.refusal import none_is_safe
from excite.campaign.candidates.registry import SEARCHES
from excite.campaign.candidates.search import Asked
from excite.campaign.candidates.series import SeriesSettings
from excite.campaign.candidates.source import check_generator
from excite.campaign.choice import Choice, Rehearsed, Rule, choose_motions
from excite.campaign.expected.forecast import TARGET_RSD, check_target
from excite.campaign.planned import Plan
from excite.campaign.pool import Keeper, Pool, ranked_segments
from excite.errors import InputError, NoSolutionError
from excite.excitation.conditioning import compute_conditioning
from excite.excitation.selection import BEST_THREE, check_selection
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.reading.number import check_count, check_number, check_seed
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.robot.bringing import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.safety.checks.robustness import judge_robustness
from excite.safety.checks.sweep import Sweep
from excite.safety.filter_report import FilterReport
from excite.safety.parameter_set import stated_parameters
from excite.safety.verdict import Robustness
from excite.temporary_folder import TemporaryFolder

# Each takes some ten milliseconds, and those that are safe wait on disk: a million are a night's work of one machine.
MAX_CANDIDATES = 1_000_000
# From one sample to a season at the robot [s].
_BUDGETS_S = (1e-3, 1e7)


def plan(
    robot: RobotLike,
    *,
    n_candidates: int | None = None,
    targets: Sequence[str] = (),
    generator: str | None = None,
    series: SeriesSettings | None = None,
    selection: str = BEST_THREE,
    budget_s: float | None = None,
    target_rsd: float = TARGET_RSD,
    before: Sequence[Motion] = (),
    robust: bool = False,
    seed: int | np.random.SeedSequence = 0,
    prefix: str = "",
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Plan:
    """Plan excitation motions (Jovic et al. 2015, section II.B).

    What is chosen was found safe by the independent check, and stood its rehearsal in simulation. Accepted motions
    wait in a temporary folder (of ``TMPDIR``) for as long as the plan is there, so that memory does not grow with
    their number. A user who interrupts (Ctrl-C) after the first of them gets the best so far, not rehearsed:
    ``interrupted`` of the plan says so.

    Args:
        robot: the robot, or what :func:`~excite.robot.bringing.load_robot` takes.
        n_candidates: how many candidate motions to generate; if None 140, and twice as many more while fewer than
            three motions come of them.
        targets: joints to aim at; all, if empty.
        generator: the only one to use: a name of the registry, or of a search such as ``optimised_fourier``,
            of which each candidate is a start; None for the robot's mixture.
        series: criterion and period of ``optimised_fourier``, with which alone they go.
        selection: ``best_three`` motions of every segment; or, within ``budget_s``, those of greatest ``log_det``
            (log-determinant), of least ``rsd`` (sum of predicted relative standard deviations), or few that give
            all ``segments`` together low condition numbers.
        budget_s: duration that the chosen motions stay within together [s], except for ``best_three``; as long as
            the best three take, if None.
        target_rsd: relative standard deviation that the plan says how much motion it would take to reach [percent].
        before: motions that were run already; what is to be expected counts them too.
        robust: plan for all robots of the set that the description states under ``uncertainty`` (or of its default):
            torque, zero-moment point and friction keep their limits whichever of them is there.
        seed: of all random numbers.
        prefix: put before the name of every motion.
        jobs: number of processes, or an executor; the plan does not depend on it.
        progress: told as work proceeds.

    Returns:
        The plan.

    Raises:
        KeyboardInterrupt: the user interrupted before any candidate was accepted.
        NoSolutionError: no candidate was accepted; the error says what refuses most and what would help; its
            ``best`` are the :class:`~excite.campaign.candidates.refusal.Refusals`.
        UnknownNameError: a target is no joint of the robot, or the generator or the selection is unknown.
        InputError: fewer than one candidate asked for, or settings that do not go together.
    """
    robot = as_robot(robot)
    count = N_CANDIDATES if n_candidates is None else n_candidates
    check_count(count, "n_candidates", 1, MAX_CANDIDATES)
    check_target(target_rsd)
    _check_settings(generator, series, selection, budget_s)
    root = check_seed(seed)
    asked = Asked(robot, count, targets, series, jobs, progress, robust)
    folder = TemporaryFolder()
    judged = Judged(generator, asked, root, Keeper(folder.path, prefix), TURNS if n_candidates is None else 1)
    seconds_of = dict.fromkeys(("generate", "filter", "rank", "choose"), 0.0)
    report, base, choice = _judge_and_choose(judged, Rule(selection, budget_s), folder, seconds_of)
    refusals = judged.refusals(report, choice.fallen)
    started = time.perf_counter()
    pool = choice.pool
    indices = choice.selection.indices
    chosen = compute_conditioning(robot, pool.factors.only(indices), base)
    seconds = float(pool.durations[list(indices)].sum())
    unchosen = compute_conditioning(robot, pool.factors.only(pool.first_seconds(seconds)), base)
    robust_margins = _robustness(asked, pool.motions.only(indices)) if not choice.interrupted else ()
    rejected = {**report.rejected, **Counter(refused.reason for refused in choice.fallen)}
    seconds_of["choose"] += time.perf_counter() - started
    return Plan(
        robot=robot,
        generated=report.generated,
        rejected=rejected,
        refusals=refusals,
        pool=pool,
        selection=choice.selection,
        validation=choice.validation,
        conditioning=chosen,
        unchosen=unchosen,
        stages={**seconds_of, **judged.seconds},
        load=choice.load,
        interrupted=choice.interrupted,
        target_rsd=target_rsd,
        before=tuple(before),
        robust=robust_margins,
    )


def _robustness(asked: Asked, motions: Sequence[Motion]) -> tuple[Robustness, ...]:
    """Least margins of motions over the robots that the description states."""
    shared = (asked.robot, asked.robust)
    return tuple(in_order(_robustness_of, motions, jobs=asked.jobs, shared=shared, total=len(motions)))


def _robustness_of(shared: tuple[Robot, bool], motion: Motion) -> Robustness:
    robot, decides = shared
    # The verdict has looked between the samples.
    sweep = Sweep(robot, motion, (motion.n_samples - 1) / motion.duration)
    return judge_robustness(sweep, stated_parameters(robot), decides=decides)


class _Chosen(NamedTuple):
    """What became of the candidates, the base parameters they are ranked by, and the choice."""

    report: FilterReport
    base: BaseParameters
    choice: Choice


def _judge_and_choose(
    judged: Judged, rule: Rule, folder: TemporaryFolder, seconds: dict[str, float]
) -> _Chosen:
    """Candidates judged, and motions chosen of the safe ones: of more while there are too few, as far as that goes.

    ``seconds`` of the stages ``rank`` and ``choose`` are added up in passing.
    """
    robot, rehearsed = judged.asked.robot, Rehearsed()
    base = structural_base_parameters(robot)
    while True:
        report = judged.more()
        if not report.kept:
            if report.interrupted:
                raise KeyboardInterrupt
            raise none_is_safe(robot, judged.refusals(report))
        filtered = time.perf_counter()
        pool = Pool(report.kept, folder, ranked_segments(robot))
        ranked = time.perf_counter()
        seconds["rank"] += ranked - filtered
        try:
            choice = choose_motions(
                robot,
                pool,
                base,
                rule,
                judged.asked.jobs,
                judged.asked.progress,
                rehearsed,
                interrupted=report.interrupted,
            )
        except NoSolutionError:
            if judged.exhausted:
                raise
            continue
        finally:
            seconds["choose"] += time.perf_counter() - ranked
        if len(choice.pool.entries) >= ENOUGH or judged.exhausted or choice.interrupted:
            return _Chosen(report, base, choice)


def _check_settings(
    generator: str | None, series: SeriesSettings | None, selection: str, budget_s: float | None
) -> None:
    """Raise InputError or UnknownNameError where settings are unknown or do not go together."""
    check_selection(selection)
    check_generator(generator)
    if series is not None and generator not in SEARCHES:
        raise InputError(
            "criterion and period are those of optimised series",
            field="series",
            remedy=f"ask for the generator {' or '.join(map(repr, SEARCHES))}, or leave them out",
        )
    if budget_s is None:
        return
    check_number(budget_s, "budget", *_BUDGETS_S, "s")
    if selection == BEST_THREE:
        raise InputError(
            "the best three of every segment take as long as they take",
            field="budget",
            remedy="choose by another selection, or leave it out",
        )
