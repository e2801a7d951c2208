"""The diagnosis of a fixed-base arm with joint torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.arm_curves import trial_curves
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap, share_closed
from excite.diagnosis.answer.locate import locate
from excite.diagnosis.answer.result import Diagnosis, Rollout
from excite.diagnosis.answer.shrink import gap_of
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
from excite.diagnosis.equations.units import at_joint
from excite.diagnosis.next_experiment.advice import advice
from excite.diagnosis.search.attribute import Attributor
from excite.diagnosis.search.attribution import Attribution, Scored
from excite.diagnosis.search.unnamed import in_words
from excite.diagnosis.search.verdict import Judgement, judge, probabilities, withdrawn
from excite.diagnosis.simulator.accepted_values import found_effects
from excite.diagnosis.simulator.found import Found
from excite.diagnosis.simulator.rollout_compare import simulated
from excite.logs.log import Log
from excite.robot.robot import Robot

_LISTED = 8


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

    return diagnose_torques(robot, log, log.header.modelled, rng, simulate, out)


def diagnose_torques(
    robot: Robot,
    log: Log,
    modelled: tuple[str, ...],
    rng: np.random.Generator,
    simulate: Callable[[Attribution, Baseline], Rollout | None],
    out: Path | None = None,
    floor_of: Callable[[ArmSamples], Array] = spectral_floor,
    effects_tried: tuple[Effect, ...] | None = None,
) -> Diagnosis:
    """Diagnose repaired trials that have torques, measured or reconstructed.

    Args:
        robot: the nominal model.
        log: the log, for its header and roles.
        modelled: what the baseline has, and effects that are not to be tried.
        rng: of the bootstrap.
        simulate: makes the roll-outs from the attribution and the baseline before it.
        out: folder for the motion of the next experiment; none is planned without it.
        floor_of: noise of the torques in the rows' band, ``(n_joints,)`` [N·m].
        effects_tried: the library of effects; all of them where it is None.

    Returns:
        The diagnosis.
    """
    samples = arm_samples(robot, log, log.trials)
    spectral = floor_of(samples)
    # Torques that were not measured are no better further up in the spectrum.
    least = np.minimum(white_floor(samples), spectral) if floor_of is spectral_floor else spectral
    baseline = fit_baseline(samples, modelled, least)
    columns = [log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, log.trials)
    noise = kinematic_noise(baseline, sigma, np.random.default_rng(0))
    judged = noise * baseline.strict
    spectral = np.hypot(spectral, np.sqrt((judged**2).mean(axis=1)))
    library = tuple(EFFECTS.values()) if effects_tried is None else effects_tried
    attribution = Attributor(baseline, spectral, unrepeated(samples, judged), effects=library).run()
    judgement = judge(attribution, spectral)
    impossible = [item for item in attribution.accepted[:1] if not item.hypothesis.physical]
    if judgement.verdict == "unknown" and attribution.accepted:
        attribution = withdrawn(attribution, baseline)
    first = attribution.stages[0]
    before, floor = baseline.plain(attribution.before.residual), attribution.floor
    after = baseline.plain(attribution.after.residual)
    repeat = repeat_floor(samples, after)
    outside = ~samples.identification
    outside = outside if outside.any() else samples.identification
    if repeat is not None:
        floor = other_postures(np.maximum(repeat, 0.5 * floor), unrepeated(samples, noise, outside))
    # Of an unknown gap nobody can say what part of it friction holds.
    if judgement.verdict != "unknown":
        floor = np.sqrt(floor**2 + held_power(samples, after, floor, outside))
    closed = after if attribution.accepted else before
    gap = gap_of(samples, before, closed, floor, attribution.scale, rng)
    effects = tuple(
        _together(_candidate(item, Context(item.hypothesis.baseline), gap, attribution, tied), found)
        for item, tied, found in zip(
            attribution.accepted, judgement.tied, found_effects(attribution), strict=True
        )
    )
    listed, n_tied = _listed(attribution, judgement, gap, effects)
    # What does not repeat is a gap all the same: the map heeds the noise alone.
    quiet = np.minimum(attribution.floor, spectral)
    where = locate(first.context, attribution.before, quiet, attribution.scale)
    warnings = []
    if not log.role("validation"):
        warnings.append(
            "the log has no validation trial: everything was judged on the trials it was fitted on"
        )
    if effects and judgement.structured:
        warnings.append("a gap above the noise is left at " + ", ".join(judgement.structured))
    warnings += [
        f"{item.name.replace('_', ' ')} at {item.location} takes up most of the gap, but would leave that link "
        "less than no mass: something else looks like it"
        for item in impossible
    ]
    if attribution.stranger is not None:
        warnings.append(in_words(attribution.stranger))
    location = effects[0].location if effects else None
    if judgement.verdict == "unknown":
        location = judgement.structured[0]
    return Diagnosis(
        robot=robot.name,
        verdict=judgement.verdict,
        effect=effects[0].effect if effects else None,
        location=location,
        tied_locations=effects[0].tied_locations if effects else (),
        candidates=listed,
        effects=effects,
        gap=gap,
        where=where,
        simulation=simulate(attribution, baseline),
        n_tied=n_tied,
        next_experiment=advice(baseline, attribution, judgement, out),
        warnings=tuple(warnings),
        curves=trial_curves(samples, before, closed),
    )


def _candidate(
    item: Scored, context: Context, gap: Gap, attribution: Attribution, tied: tuple[str, ...] = ()
) -> Candidate:
    """A scored hypothesis as it stands in the document; gaps on the validation trials."""
    h = item.hypothesis
    rows = ~attribution.final.samples.identification
    residual = h.baseline.plain(h.fit.residual)
    residual = residual[:, rows] if rows.any() else residual
    after = float(np.sqrt(np.mean((residual**2).mean(axis=1) / attribution.scale**2)))
    return Candidate(
        effect=item.name,
        location=item.location,
        parameters=at_joint(
            context.baseline.samples.robot,
            item.location,
            h.effect.estimates(context, item.location, h.theta, h.told),
        ),
        evidence=item.evidence,
        gap_after=after,
        share_closed=share_closed(gap.before, after, gap.noise_floor),
        tied_locations=tied,
    )


def _together(item: Candidate, found: Found) -> Candidate:
    """An accepted effect with the values that it has beside all others, not those when it was alone."""
    values = {
        name: replace(estimate, value=found.values.get(name, estimate.value))
        for name, estimate in item.parameters.items()
    }
    return replace(item, parameters=values)


def _listed(
    attribution: Attribution, judgement: Judgement, gap: Gap, effects: tuple[Candidate, ...]
) -> tuple[tuple[Candidate, ...], int]:
    """Candidates for the first effect, likeliest first, and how many of them are tied."""
    first = attribution.stages[0]
    made = [_candidate(item, Context(item.hypothesis.baseline), gap, attribution) for item in first.ranking]
    if not effects:
        return tuple(made[:_LISTED]), 0
    best = first.accepted
    chance = probabilities(best, first.ranking, judgement.explained) if best is not None else {}
    made = [replace(c, probability=chance.get((c.effect, c.location or ""))) for c in made]
    # The place may be open where the name is not.
    sure = sum(chance.get((effects[0].effect, place), 0.0) for place in effects[0].tied_locations)
    head = [replace(effects[0], probability=sure)]
    if judgement.renamed[0] is not None:
        head[0] = replace(head[0], probability=0.5 * sure)
        head.append(replace(head[0], effect=judgement.renamed[0]))
    twins = {(r.name, r.location): twin for r, twin in zip(judgement.rivals, judgement.twins, strict=True)}
    for c in made:
        if (c.effect, c.location) not in twins:
            continue
        twin = twins[c.effect, c.location or ""]
        # Two names for one thing share its probability.
        chance_of = c.probability if twin is None or c.probability is None else 0.5 * c.probability
        head.append(replace(c, probability=chance_of))
        head += [] if twin is None else [replace(head[-1], effect=twin)]
    known = {(c.effect, c.location) for c in head}
    rest = [c for c in made if (c.effect, c.location) not in known]
    return tuple((head + rest)[:_LISTED]), len(head) if judgement.verdict == "ambiguous" else 0
