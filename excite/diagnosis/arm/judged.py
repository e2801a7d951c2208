"""What is found in a record of torques: effects, one after the other, and beside them the budget of the gap."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.arm.joined import joined
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.budget.library import NAMELESS
from excite.diagnosis.budget.made import budget_of
from excite.diagnosis.budget.record import begun_baseline, model_of_gap
from excite.diagnosis.budget.same_machine import other_machine
from excite.diagnosis.budget.unison import unison
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.kinematic_noise import kinematic_noise, position_noise
from excite.diagnosis.equations.known_drives import known_terms, less_known
from excite.diagnosis.equations.noise_floor import spectral_floor, unrepeated, white_floor
from excite.diagnosis.equations.samples import ArmSamples, arm_samples
from excite.diagnosis.search.attribute import Attributor
from excite.diagnosis.search.attribution import Attribution, Scored
from excite.diagnosis.search.scoring import Scorer
from excite.diagnosis.search.verdict import Judgement, judge, withdrawn
from excite.finding import Finding


@dataclass(frozen=True, eq=False)
class Judged:
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
        tried: effects that were accepted one after the other, withdrawn or not.
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
    tried: tuple[Scored, ...] = ()


@dataclass(frozen=True, eq=False)
class _Ready:
    """A record with its baseline fitted; attributes as of :class:`Judged`."""

    samples: ArmSamples
    baseline: Baseline
    spectral: Array
    noise: Array


def judged_record(record: TorqueRecord) -> Judged:
    """Find what a record's gap is made of, beside a baseline that is fitted first."""
    samples = arm_samples(record.robot, record.log, record.log.trials)
    if known_terms(samples, record.modelled):
        samples = less_known(samples, record.modelled, spectral_floor(samples))
    spectral = (record.reconstructed_noise or spectral_floor)(samples)
    # Torques that were not measured are no better further up in the spectrum.
    measured = record.reconstructed_noise is None
    least = np.minimum(white_floor(samples), spectral) if measured else spectral
    baseline = fit_baseline(samples, record.modelled, least)
    columns = [record.log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, record.log.trials)
    noise = kinematic_noise(baseline, sigma, np.random.default_rng(0))
    spectral = np.hypot(spectral, np.sqrt(((noise * baseline.strict) ** 2).mean(axis=1)))
    found = _one_by_one(record, _Ready(samples, baseline, spectral, noise))
    return _with_budget(record, found, least) if record.budget else found


def _with_budget(record: TorqueRecord, found: Judged, least: Array) -> Judged:
    """Where each joint's gap goes by one model of all effects, and those that show only there named too."""
    samples = found.samples
    tau = samples.rows([t.measured for t in samples.trials])[samples.identification]
    full = begun_baseline(samples, record.modelled, least)
    together = unison(full)
    # On one path any list of effects could stand for any other.
    effects = record.effects if together is None else _own_terms(record.effects)
    gap = model_of_gap(full, record.modelled, (*effects, *NAMELESS), least, _forms(found, effects))
    scale = np.maximum(tau.std(axis=0), 1e-9)
    budget = budget_of(gap, found.spectral, scale)
    said = (*(() if together is None else (together,)), *other_machine(gap.search.model))
    found = replace(found, budget=budget, findings=said)
    if together is not None:
        return found
    scorer = Scorer(
        found.baseline, found.spectral, unrepeated(samples, found.noise * found.baseline.strict), scale
    )
    attribution, judgement = joined(found.attribution, found.judgement, gap, budget, scorer)
    return replace(found, attribution=attribution, judgement=judgement)


def _one_by_one(record: TorqueRecord, ready: _Ready) -> Judged:
    """The search for one effect after the other."""
    baseline = ready.baseline
    judged = unrepeated(ready.samples, ready.noise * baseline.strict)
    attribution = Attributor(baseline, ready.spectral, judged, effects=record.effects).run()
    judgement = judge(attribution, ready.spectral)
    tried = attribution.accepted
    impossible = tuple(item for item in attribution.accepted[:1] if not item.hypothesis.physical)
    if judgement.verdict == "unknown" and attribution.accepted:
        attribution = withdrawn(attribution, baseline)
    return Judged(
        ready.samples,
        baseline,
        ready.spectral,
        ready.noise,
        attribution,
        judgement,
        impossible,
        tried=tried,
    )


def _forms(found: Judged, effects: tuple[Effect, ...]) -> tuple[tuple[Effect, str, Theta], ...]:
    """Forms of what the search for one effect after the other has found, where they are to be tried."""
    names = {effect.name for effect in effects}
    items = [item.hypothesis for item in found.tried if item.name in names]
    return tuple((h.effect, h.location, h.theta) for h in items)


def _own_terms(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Effects that are terms of a joint's drive, told by its own motion."""
    return tuple(effect for effect in effects if effect.term is not None)
