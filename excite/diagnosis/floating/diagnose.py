"""The diagnosis of a floating-base log: contact wrenches against what the motion needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap
from excite.diagnosis.answer.result import Diagnosis, NextExperiment
from excite.diagnosis.floating.answer.curves import trial_curves
from excite.diagnosis.floating.answer.gap import gap_of
from excite.diagnosis.floating.answer.held_out import refit
from excite.diagnosis.floating.answer.where import locate
from excite.diagnosis.floating.equations.problem import Problem, build_problem
from excite.diagnosis.floating.equations.record import prepare_record
from excite.diagnosis.floating.search.attribution import Attribution, attribute
from excite.diagnosis.floating.search.ranking import DECISIVE, NOISE_SLACK, Ranked
from excite.diagnosis.floating.search.refinement import Fitted
from excite.diagnosis.floating.search.unknown_place import unknown_places
from excite.diagnosis.floating.simulator.rollout_compare import simulated
from excite.logs.log import Log
from excite.robot.robot import Robot

_N_CANDIDATES = 8


@dataclass(frozen=True, eq=False)
class Analysis:
    """A record with its verdict and what is fitted to the identification trials alone.

    Attributes:
        problem: the problem.
        found: the verdict on all trials.
        before: the baseline's fit to the identification trials.
        after: that of the accepted effects; the baseline's where there are none.
    """

    problem: Problem
    found: Attribution
    before: Fitted
    after: Fitted


def analyse(log: Log, robot: Robot | None = None) -> Analysis:
    """Prepare a log, find what explains it, and fit that again without the validation trials.

    Args and errors as of :func:`diagnose_floating`.
    """
    problem = build_problem(prepare_record(log, robot))
    found = attribute(problem)
    accepted = found.accepted if found.verdict in {"effect", "ambiguous"} else found.baseline
    return Analysis(problem, found, *refit(problem, accepted))


def diagnose_floating(
    log: Log,
    robot: Robot | None = None,
    rng: np.random.Generator | None = None,
    out: Path | None = None,
) -> Diagnosis:
    """Diagnose a log with base pose, joints and contact wrenches.

    Args:
        log: the log.
        robot: its nominal robot with the log's sensors; None reads the one that the log names.
        rng: of the bootstrap and of the roll-outs' replicas; None is seeded with zero.
        out: folder for the augmented simulator; none is written without it.

    Raises:
        LogError: the log lacks base pose or wrenches, or a trial is too short.
    """
    return diagnosis_of(analyse(log, robot), rng, out)


def diagnosis_of(
    analysis: Analysis, rng: np.random.Generator | None = None, out: Path | None = None
) -> Diagnosis:
    """What an analysis says, with the gap's interval from a bootstrap, and roll-outs; arguments as above."""
    problem, found, rng = analysis.problem, analysis.found, rng or np.random.default_rng(0)
    accepted = found.accepted if found.verdict in {"effect", "ambiguous"} else found.baseline
    gap = gap_of(problem, analysis.before, analysis.after, rng)
    first = found.steps[0] if found.steps and accepted.placed else ()
    tied = found.tied[0] if first else ()
    if found.verdict == "unknown":
        tied = unknown_places(problem, found.baseline)
    return Diagnosis(
        robot=problem.record.robot.name,
        verdict=found.verdict,
        effect=_name(first[0]) if first else None,
        location=first[0].last.location if first else (tied[0] if tied else None),
        tied_locations=tied,
        candidates=_candidates(problem, found, gap),
        effects=_effects(problem, found, gap) if accepted.placed else (),
        gap=gap,
        where=locate(problem, found.baseline),
        simulation=simulated(problem, analysis.before, analysis.after, rng, out),
        n_tied=len(found.rivals) if found.verdict == "ambiguous" else 0,
        next_experiment=_next(found),
        warnings=_warnings(problem, found),
        curves=trial_curves(problem, analysis.before, analysis.after),
    )


def _name(item: Ranked) -> str:
    return item.last.effect.called(item.fitted.theta[-1])


def _candidates(problem: Problem, found: Attribution, gap: Gap) -> tuple[Candidate, ...]:
    """The leading hypotheses for the first effect, those that cannot be told apart first."""
    if not found.steps:
        return ()
    step = found.steps[0]
    chosen = _one_each(found.rivals, step)
    weights = _probabilities(chosen)
    return tuple(
        _candidate(problem, found, item, step, gap, float(weight))
        for item, weight in list(zip(chosen, weights, strict=True))[:_N_CANDIDATES]
    )


def _one_each(first: Sequence[Ranked], step: Sequence[Ranked]) -> list[Ranked]:
    """The hypotheses ``first``, then those of a step whose effects are not among them, each at its likeliest place."""
    chosen, seen = list(first), {item.last.effect.name for item in first}
    for item in step:
        if item.last.effect.name not in seen:
            seen.add(item.last.effect.name)
            chosen.append(item)
    return chosen


def _probabilities(chosen: Sequence[Ranked]) -> Array:
    """Of hypotheses of which one is true, ``(n,)``."""
    evidence = np.array([item.evidence for item in chosen])
    weights = np.exp(np.maximum(evidence - evidence.max(), -700.0))
    return np.asarray(weights / weights.sum())


def _candidate(
    problem: Problem, found: Attribution, item: Ranked, step: tuple[Ranked, ...], gap: Gap, weight: float
) -> Candidate:
    own = [other for other in step if other.last.effect.name == item.last.effect.name]
    close = tuple(other.last.location for other in own if other.evidence > item.evidence - DECISIVE)
    tied = found.tied[0] if found.tied and item is step[0] else close
    share, after = _closed(problem, found, item.fitted, gap)
    placed = item.last
    return Candidate(
        effect=_name(item),
        location=placed.location,
        parameters=placed.effect.report(
            problem.nominal, placed.location, item.fitted.theta[-1], item.fitted.std[-1]
        ),
        evidence=float(item.evidence),
        gap_after=after,
        share_closed=share,
        tied_locations=tied,
        probability=weight,
    )


def _closed(problem: Problem, found: Attribution, fitted: Fitted, gap: Gap) -> tuple[float, float]:
    """Share of the power above the noise that a fit closes, whitened, and the gap that this leaves."""
    n = len(problem.nominal_rows)
    open_power = found.baseline.power - n
    share = 0.0 if open_power <= 0.0 else float(np.clip(1.0 - (fitted.power - n) / open_power, 0.0, 1.0))
    left = (1.0 - share) * max(gap.before**2 - gap.noise_floor**2, 0.0)
    return share, float(np.sqrt(gap.noise_floor**2 + left))


def _effects(problem: Problem, found: Attribution, gap: Gap) -> tuple[Candidate, ...]:
    """The accepted effects in the order in which they were added, at the parameters of the joint fit."""
    final, out = found.accepted, []
    for k, step in enumerate(found.steps):
        best = step[0]
        placed = final.placed[k]
        share, after = _closed(problem, found, found.partial[k], gap)
        out.append(
            Candidate(
                effect=placed.effect.called(final.theta[k]),
                location=placed.location,
                parameters=placed.effect.report(
                    problem.nominal, placed.location, final.theta[k], final.std[k]
                ),
                evidence=float(best.evidence),
                gap_after=after,
                share_closed=share,
                tied_locations=found.tied[k],
                probability=float(_probabilities(_one_each((), step))[0]),
            )
        )
    return tuple(out)


def _next(found: Attribution) -> NextExperiment | None:
    if found.verdict != "ambiguous":
        return None
    rivals = tuple(f"{_name(item)}@{item.last.location}" for item in found.rivals)
    reasons = "; ".join(sorted({f"{_name(item)}: {item.last.effect.reads_as}" for item in found.rivals}))
    return NextExperiment(why=f"tell {' from '.join(rivals)} ({reasons})", separates=rivals)


def _warnings(problem: Problem, found: Attribution) -> tuple[str, ...]:
    notes = []
    if problem.record.inertials_free:
        notes.append(
            "inertial parameters are identified: payloads and link inertias are part of them, and what "
            "they can imitate (with force plates, joint offsets, link lengths and a tilted base) is invisible"
        )
    if problem.repeatability.level is None:
        notes.append("no repeated trial: the noise is taken from above the motion's band alone")
    if not problem.repeatability.repeatable:
        notes.append("repeated trials differ by more than noise: something outside the log acts on the robot")
    if not problem.unloaded.sensors:
        notes.append(
            "no foot is ever in the air: a constant sensor bias looks like a constant external force"
        )
    if not any(problem.record.validation):
        notes.append("no validation trial: the gap is that of the trials that were fitted")
    if found.verdict in {"effect", "ambiguous"} and found.overdispersion > NOISE_SLACK:
        notes.append(f"{found.overdispersion:.1f} times the noise's power is left unexplained")
    return tuple(notes)
