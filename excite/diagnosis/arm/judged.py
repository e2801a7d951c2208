"""What is found in a record of torques: the model of its gap, its budget, and the verdict that is read from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.arm.read import Reading
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.attribution.judgement import Judgement
from excite.diagnosis.attribution.scoring import Scorer
from excite.diagnosis.budget.between_trials import sizes_by_trial
from excite.diagnosis.budget.library import NAMELESS
from excite.diagnosis.budget.loaded_trials import part_time_payload, trials_that_carry
from excite.diagnosis.budget.made import budget_of
from excite.diagnosis.budget.record import begun_baseline, model_of_gap, rows_of
from excite.diagnosis.budget.same_machine import other_machine
from excite.diagnosis.budget.unison import unison
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.kinematic_noise import kinematic_noise, position_noise
from excite.diagnosis.equations.known_drives import known_terms, less_known
from excite.diagnosis.equations.known_motion import bands_by_noise
from excite.diagnosis.equations.noise_floor import spectral_floor, unrepeated, white_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standing_joints import stands_throughout, with_held
from excite.finding import Finding


@dataclass(frozen=True, eq=False)
class Judged:
    """What was found in the rows, and the noise by which it was judged.

    Attributes:
        samples: the repaired trials at one rate.
        baseline: before the first effect.
        spectral: noise in the rows' band, positions' share in it, ``(n_joints,)`` [N·m].
        noise: what noise of the positions leaves in the rows, ``(n_joints, n_rows)`` [N·m].
        attribution: the effects, in the equations.
        judgement: the verdict on them.
        budget: where each joint's gap goes.
        findings: what limits what the record can tell.
    """

    samples: ArmSamples
    baseline: Baseline
    spectral: Array
    noise: Array
    attribution: Attribution
    judgement: Judgement
    budget: Budget
    findings: tuple[Finding, ...] = ()


def judged_record(record: TorqueRecord) -> Judged:
    """Find what a record's gap is made of."""
    # Torques that were made of positions are as late and as noisy as these.
    measured = record.reconstructed_noise is None
    bands = bands_by_noise(record.log, record.log.trials) if measured else None
    samples = arm_samples(record.robot, record.log, record.log.trials, bands)
    if known_terms(samples, record.modelled):
        samples = less_known(samples, record.modelled, spectral_floor(samples))
    spectral = (record.reconstructed_noise or spectral_floor)(samples)
    # Torques that were not measured are no better further up in the spectrum.
    least = np.minimum(white_floor(samples), spectral) if measured else spectral
    full = begun_baseline(samples, record.modelled, least)
    samples = full.samples
    baseline = fit_baseline(samples, record.modelled, least, like=full)
    columns = [record.log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, record.log.trials)
    noise = kinematic_noise(baseline, sigma, np.random.default_rng(0))
    spectral = np.hypot(spectral, np.sqrt(((noise * baseline.strict) ** 2).mean(axis=1)))
    tau = samples.rows([t.measured for t in samples.trials])[samples.identification]
    # A joint that stands throughout leaves what holds it, in units of next to no torque: no part of the whole gap.
    scale = np.where(stands_throughout(samples), np.inf, np.maximum(tau.std(axis=0), 1e-9))
    together = unison(full)
    # On one path any list of effects could stand for any other, and what has no name for any that has.
    effects = (*record.effects, *NAMELESS) if together is None else _own_terms(record.effects)
    if together is None and (loaded := _loaded(full, least)) is not None:
        effects = (*effects, loaded)
    found = model_of_gap(full, record.modelled, effects, least, sigma)
    model, context = found.search.model, found.prediction.context
    spectral = with_held(samples, model.residual, spectral)
    budget = budget_of(found, spectral, scale)
    said = (*(() if together is None else (together,)), *other_machine(model))
    said = (*said, *sizes_by_trial(model, context, found.baseline.strict, spectral))
    scorer = Scorer(baseline, spectral, unrepeated(samples, noise * baseline.strict), scale)
    attribution, judgement = Reading(found, budget, scorer).verdict()
    named = ((item.hypothesis.effect, item.location) for item in attribution.accepted)
    said = (*said, *trials_that_carry(named))
    return Judged(samples, baseline, spectral, noise, attribution, judgement, budget, said)


def _loaded(full: Baseline, floor: Array) -> Effect | None:
    """The body that some trials have and others do not, told beside all that the model begins with."""
    return part_time_payload(Context(full), rows_of(full, full.modelled, floor), full.strict)


def _own_terms(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Effects that are terms of a joint's drive, told by its own motion."""
    return tuple(effect for effect in effects if effect.term is not None)
