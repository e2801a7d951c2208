"""The diagnosis of a fixed-base arm with joint torques."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.arm_curves import trial_curves
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap
from excite.diagnosis.answer.locate import locate
from excite.diagnosis.answer.result import Diagnosis, Rollout
from excite.diagnosis.answer.shrink import gap_of
from excite.diagnosis.arm.absorbed import absorbed
from excite.diagnosis.arm.candidates import (
    beside_others,
    by_blocks,
    candidate_of,
    listed_candidates,
    spread_by_blocks,
    with_others_in_it,
)
from excite.diagnosis.arm.judged import Judged, judged_record
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.arm.stranger import in_words
from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import (
    other_postures,
    repeat_floor,
    unrepeated,
    without_drift,
)
from excite.diagnosis.equations.own_columns import own_rows, own_terms
from excite.diagnosis.equations.standing_joints import held_power
from excite.diagnosis.next_experiment.advice import advice
from excite.diagnosis.simulator.accepted_values import found_effects
from excite.diagnosis.simulator.found import Found
from excite.diagnosis.simulator.robot_changes import robot_changes
from excite.diagnosis.simulator.rollout_compare import simulated
from excite.diagnosis.trivial.neighbours import of_torques
from excite.logs.log import Log
from excite.robot.robot import Robot


def diagnose_arm(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None = None) -> Diagnosis:
    """Diagnose a log of a fixed-base arm with joint torques.

    Args:
        robot: the nominal model.
        log: the log, with an identification trial.
        rng: of the bootstrap.
        out: folder for the augmented simulator; none is written without it.

    Returns:
        The diagnosis.

    Raises:
        LogError: no torques, trials too short.
    """

    def simulate(attribution: Attribution, baseline: Baseline) -> Rollout:
        return simulated(attribution, baseline, out)

    return diagnose_torques(TorqueRecord(robot, log, log.header.modelled, out), rng, simulate)


def diagnose_torques(
    record: TorqueRecord,
    rng: np.random.Generator,
    simulate: Callable[[Attribution, Baseline], Rollout | None],
) -> Diagnosis:
    """Diagnose repaired trials that have torques, measured or reconstructed.

    Args:
        record: the trials, their model and what to try.
        rng: of the bootstrap.
        simulate: makes the roll-outs from the attribution and the baseline before it.

    Returns:
        The diagnosis.
    """
    found = judged_record(record)
    samples, baseline, attribution, judgement = (
        found.samples,
        found.baseline,
        found.attribution,
        found.judgement,
    )
    first = attribution.stages[0]
    before, after = (baseline.plain(fit.residual) for fit in (attribution.before, attribution.after))
    closed = after if attribution.accepted else before
    gap = gap_of(samples, before, closed, _floor(found, before), attribution.scale, rng)
    effects = tuple(
        one
        for item, tied, values in zip(
            attribution.accepted, judgement.tied, found_effects(attribution), strict=True
        )
        for one in with_others_in_it(_accepted(item, tied, values, found, gap), item)
    )
    listed, n_tied = listed_candidates(attribution, judgement, gap, effects)
    unknown = judgement.verdict == "unknown"
    named = effects[0] if effects and not unknown else None
    location = judgement.structured[0] if unknown else None if named is None else named.location
    return Diagnosis(
        robot=record.robot.name,
        verdict=judgement.verdict,
        effect=None if named is None else named.effect,
        location=location,
        tied_locations=() if named is None else named.tied_locations,
        candidates=listed,
        effects=effects,
        gap=gap,
        where=locate(first.context, attribution.before, found.budget.weights),
        simulation=simulate(attribution, baseline),
        n_tied=n_tied,
        next_experiment=advice(baseline, attribution, judgement, record.out),
        warnings=_warnings(record, found, effects),
        budget=found.budget,
        absorbed=absorbed(baseline),
        faults=found.findings,
        trivial={} if record.reconstructed_noise else of_torques(samples, closed),
        changes=robot_changes(attribution, baseline),
        curves=trial_curves(samples, before, closed),
    )


def _accepted(item: Scored, tied: tuple[str, ...], values: Found, found: Judged, gap: Gap) -> Candidate:
    """An accepted effect with its sizes beside all others, and one deviation of each wherever it is told."""
    spread = spread_by_blocks(found.budget, item)
    context = Context(item.hypothesis.baseline)
    alone = candidate_of(item, context, gap, found.attribution, tied, spread)
    return by_blocks(beside_others(alone, values), found.budget, spread)


def _floor(found: Judged, before: Array) -> Array:
    """Noise of the torques, by joint [N·m]: what repeats of a command differ by, and what friction holds.

    By the record before any effect, so that no floor depends on what was found.
    """
    samples, baseline, floor = found.samples, found.baseline, found.spectral
    outside = samples.judging
    if samples.repeats:
        terms = own_terms(("viscous_friction", "coulomb_friction", "torque_bias"))
        own = [own_rows(samples, terms, j, [sign])[0] for j, sign in enumerate(baseline.signs)]
        repeat = repeat_floor(samples, without_drift(samples, before, own))
        if repeat is not None:
            more = unrepeated(samples, found.noise, outside)
            floor = other_postures(np.maximum(repeat, 0.5 * floor), more)
    return np.sqrt(floor**2 + held_power(samples, before, floor, outside))


def _warnings(record: TorqueRecord, found: Judged, effects: tuple[Candidate, ...]) -> tuple[str, ...]:
    """Limits of what is said, one sentence each."""
    warnings = []
    if not record.log.role("validation"):
        warnings.append(
            "the log has no validation trial: everything was judged on the trials it was fitted on"
        )
    if effects and found.judgement.structured:
        warnings.append("a gap above the noise is left at " + ", ".join(found.judgement.structured))
    if found.attribution.stranger is not None:
        warnings.append(in_words(found.attribution.stranger))
    return tuple(warnings)
