"""The diagnosis of a fixed-base arm with joint torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.arm_curves import trial_curves
from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.locate import locate
from excite.diagnosis.answer.result import Diagnosis, Rollout
from excite.diagnosis.answer.shrink import gap_of
from excite.diagnosis.arm.attributed import attributed
from excite.diagnosis.arm.candidates import beside_others, candidate_of, listed_candidates
from excite.diagnosis.budget.library import NAMELESS
from excite.diagnosis.budget.made import budget_of
from excite.diagnosis.budget.record import begun_baseline, model_of_gap
from excite.diagnosis.budget.same_machine import other_machine
from excite.diagnosis.budget.unison import unison
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.kinematic_noise import kinematic_noise, position_noise
from excite.diagnosis.equations.noise_floor import (
    other_postures,
    repeat_floor,
    spectral_floor,
    unrepeated,
    white_floor,
)
from excite.diagnosis.equations.samples import ArmSamples, arm_samples
from excite.diagnosis.equations.standing_joints import held_power
from excite.diagnosis.next_experiment.advice import advice
from excite.diagnosis.search.attribute import Attributor
from excite.diagnosis.search.attribution import Attribution, Scored
from excite.diagnosis.search.scoring import Scorer
from excite.diagnosis.search.unnamed import in_words
from excite.diagnosis.search.verdict import Judgement, judge, withdrawn
from excite.diagnosis.simulator.accepted_values import found_effects
from excite.diagnosis.simulator.rollout_compare import simulated
from excite.finding import Finding
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


@dataclass(frozen=True, eq=False)
class TorqueRecord:
    """Repaired trials that have torques, measured or reconstructed.

    Attributes:
        robot: the nominal model.
        log: the log, its trials repaired.
        modelled: what the baseline has, and effects that are not to be tried.
        out: folder for the motion of the next experiment; none is planned without it.
        reconstructed_noise: noise of torques that were not measured, in the rows' band, ``(n_joints,)`` [N·m]; None
            where they were, whose noise stands in their spectrum.
        effects: the library of effects to try.
    """

    robot: Robot
    log: Log
    modelled: tuple[str, ...]
    out: Path | None = None
    reconstructed_noise: Callable[[ArmSamples], Array] | None = None
    effects: tuple[Effect, ...] = field(default_factory=lambda: tuple(EFFECTS.values()))


@dataclass(frozen=True, eq=False)
class _Attributed:
    """What the search found in the rows, and the noise by which it was judged.

    Attributes:
        samples: the repaired trials at one rate.
        baseline: before the first effect.
        spectral: noise in the rows' band, positions' share in it, ``(n_joints,)`` [N·m].
        noise: what noise of the positions leaves in the rows, ``(n_joints, n_rows)`` [N·m].
        attribution: all steps of the search; withdrawn where nothing is named.
        judgement: the verdict on it.
        impossible: the best candidate, where no body could be so.
        budget: where each joint's gap goes; None where torques were not measured.
        findings: what limits what the record can tell.
    """

    samples: ArmSamples
    baseline: Baseline
    spectral: Array
    noise: Array
    attribution: Attribution
    judgement: Judgement
    impossible: tuple[Scored, ...]
    budget: Budget | None = None
    findings: tuple[Finding, ...] = ()


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
    found = _attributed(record)
    samples, baseline, attribution, judgement = (
        found.samples,
        found.baseline,
        found.attribution,
        found.judgement,
    )
    first = attribution.stages[0]
    before, after = (baseline.plain(fit.residual) for fit in (attribution.before, attribution.after))
    closed = after if attribution.accepted else before
    gap = gap_of(samples, before, closed, _floor(found, after), attribution.scale, rng)
    effects = tuple(
        beside_others(candidate_of(item, Context(item.hypothesis.baseline), gap, attribution, tied), values)
        for item, tied, values in zip(
            attribution.accepted, judgement.tied, found_effects(attribution), strict=True
        )
    )
    listed, n_tied = listed_candidates(attribution, judgement, gap, effects)
    # What does not repeat is a gap all the same: the map heeds the noise alone.
    quiet = np.minimum(attribution.floor, found.spectral)
    location = effects[0].location if effects else None
    if judgement.verdict == "unknown":
        location = judgement.structured[0]
    return Diagnosis(
        robot=record.robot.name,
        verdict=judgement.verdict,
        effect=effects[0].effect if effects else None,
        location=location,
        tied_locations=effects[0].tied_locations if effects else (),
        candidates=listed,
        effects=effects,
        gap=gap,
        where=locate(first.context, attribution.before, quiet, attribution.scale),
        simulation=simulate(attribution, baseline),
        n_tied=n_tied,
        next_experiment=advice(baseline, attribution, judgement, record.out),
        warnings=_warnings(record, found, effects),
        budget=found.budget,
        faults=found.findings,
        curves=trial_curves(samples, before, closed),
    )


def _attributed(record: TorqueRecord) -> _Attributed:
    """The search for effects beside a baseline that is fitted first."""
    samples = arm_samples(record.robot, record.log, record.log.trials)
    spectral = (record.reconstructed_noise or spectral_floor)(samples)
    # Torques that were not measured are no better further up in the spectrum.
    measured = record.reconstructed_noise is None
    least = np.minimum(white_floor(samples), spectral) if measured else spectral
    full = begun_baseline(samples, record.modelled, least) if measured else None
    baseline = fit_baseline(samples, record.modelled, least, like=full)
    columns = [record.log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, record.log.trials)
    noise = kinematic_noise(baseline, sigma, np.random.default_rng(0))
    judged = noise * baseline.strict
    spectral = np.hypot(spectral, np.sqrt((judged**2).mean(axis=1)))
    if full is not None:
        tau = samples.rows([t.tau for t in samples.trials])[samples.identification]
        scale = np.maximum(tau.std(axis=0), 1e-9)
        scorer = Scorer(baseline, spectral, unrepeated(samples, judged), scale)
        together = unison(baseline)
        # On one path any list of effects could stand for any other.
        named = record.effects if together is None else _own_terms(record.effects)
        found = model_of_gap(full, record.modelled, (*named, *NAMELESS), least)
        budget = budget_of(found, spectral, scale)
        read = attributed(baseline, scorer, found, budget, spectral)
        said = (*(() if together is None else (together,)), *other_machine(found.search.model))
        attribution, judgement = read.attribution, read.judgement
        return _Attributed(samples, baseline, spectral, noise, attribution, judgement, (), budget, said)
    attribution = Attributor(baseline, spectral, unrepeated(samples, judged), effects=record.effects).run()
    judgement = judge(attribution, spectral)
    impossible = tuple(item for item in attribution.accepted[:1] if not item.hypothesis.physical)
    if judgement.verdict == "unknown" and attribution.accepted:
        attribution = withdrawn(attribution, baseline)
    return _Attributed(samples, baseline, spectral, noise, attribution, judgement, impossible)


def _own_terms(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Effects that are terms of a joint's drive, told by its own motion."""
    return tuple(effect for effect in effects if effect.term is not None)


def _floor(found: _Attributed, after: Array) -> Array:
    """Noise of the torques, by joint [N·m]: what repeats of a command differ by, and what friction holds."""
    samples, floor = found.samples, found.attribution.floor
    repeat = repeat_floor(samples, after)
    outside = ~samples.identification
    outside = outside if outside.any() else samples.identification
    if repeat is not None:
        floor = other_postures(np.maximum(repeat, 0.5 * floor), unrepeated(samples, found.noise, outside))
    # Of an unknown gap nobody can say what part of it friction holds.
    if found.judgement.verdict != "unknown":
        floor = np.sqrt(floor**2 + held_power(samples, after, floor, outside))
    return floor


def _warnings(record: TorqueRecord, found: _Attributed, effects: tuple[Candidate, ...]) -> tuple[str, ...]:
    """Limits of what is said, one sentence each."""
    warnings = []
    if not record.log.role("validation"):
        warnings.append(
            "the log has no validation trial: everything was judged on the trials it was fitted on"
        )
    if effects and found.judgement.structured:
        warnings.append("a gap above the noise is left at " + ", ".join(found.judgement.structured))
    warnings += [
        f"{item.name.replace('_', ' ')} at {item.location} takes up most of the gap, but would leave that link "
        "less than no mass: something else looks like it"
        for item in found.impossible
    ]
    if found.attribution.stranger is not None:
        warnings.append(in_words(found.attribution.stranger))
    return tuple(warnings)
