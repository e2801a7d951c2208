"""Scored hypotheses as they stand in the document: with their values, what they close, and how likely they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap, share_closed
from excite.diagnosis.attribution import Attribution, Judgement, Scored
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.units import at_joint
from excite.diagnosis.simulator.model_text import Found

_LISTED = 8


def candidate_of(
    item: Scored,
    context: Context,
    gap: Gap,
    attribution: Attribution,
    tied: tuple[str, ...] = (),
    least: Mapping[str, float] = MappingProxyType({}),
) -> Candidate:
    """A scored hypothesis as it stands in the document; gaps on the validation trials.

    No linear parameter has a deviation below ``least``, and what is made of them has one that follows from theirs.
    """
    h, told = item.hypothesis, item.hypothesis.told
    known = [least.get(p.name, 0.0) for p in h.effect.linear]
    told = replace(told, extra_std=np.maximum(told.extra_std, known))
    after = h.baseline.gap(h.fit.residual, attribution.scale)
    return Candidate(
        effect=item.name,
        location=item.location,
        parameters=at_joint(
            context.baseline.samples.robot,
            item.location,
            h.effect.estimates(context, item.location, h.theta, told),
        ),
        evidence=item.evidence,
        gap_after=after,
        share_closed=share_closed(gap.before, after, gap.noise_floor),
        tied_locations=tied,
    )


def beside_others(item: Candidate, found: Found) -> Candidate:
    """An accepted effect with the values that it has beside all others, not those when it was alone."""
    values = {
        name: replace(estimate, value=found.values.get(name, estimate.value))
        for name, estimate in item.parameters.items()
    }
    return replace(item, parameters=values)


def spread_by_blocks(budget: Budget, item: Scored) -> dict[str, float]:
    """Deviations of an accepted effect's parameters between blocks left out of the model of all effects.

    Formulas know the noise and not what the model lacks: of a ball screw's offset one says ±0.05 N that is 0.24 N off.
    """
    key = item.name, item.location
    values = (other.values for other in budget.named if (other.effect, other.location) == key)
    return {name: std for known in values for name, (_, std) in known.items() if std is not None}


def by_blocks(item: Candidate, budget: Budget, spread: Mapping[str, float]) -> Candidate:
    """An accepted effect as the model of all effects has it: its probability, and no smaller deviations."""
    key = item.effect, item.location
    chance = next((o.probability for o in budget.named if (o.effect, o.location) == key), item.probability)
    values = {
        name: replace(one, std=max(spread[name], one.std or 0.0)) if name in spread else one
        for name, one in item.parameters.items()
    }
    return replace(item, parameters=values, probability=chance)


def with_others_in_it(item: Candidate, scored: Scored) -> tuple[Candidate, ...]:
    """An accepted effect, and those that its form has in it: each with the parameters that are its own."""
    along = scored.hypothesis.effect.along
    if not along:
        return (item,)
    theirs = {name for names in along.values() for name in names}
    own = {name: value for name, value in item.parameters.items() if name not in theirs}
    made = [replace(item, parameters=own)]
    for effect, names in along.items():
        made.append(replace(item, effect=effect.name, parameters={n: item.parameters[n] for n in names}))
    return tuple(made)


def listed_candidates(
    attribution: Attribution, judgement: Judgement, gap: Gap, effects: tuple[Candidate, ...]
) -> tuple[tuple[Candidate, ...], int]:
    """Candidates for the first effect, likeliest first, and how many of them are tied."""
    first = attribution.stages[0]
    made = [candidate_of(item, Context(item.hypothesis.baseline), gap, attribution) for item in first.ranking]
    if not effects:
        return tuple(made[:_LISTED]), 0
    # The place may be open where the name is not.
    sure = judgement.probability
    head = [replace(effects[0], probability=sure)]
    if judgement.renamed[0] is not None:
        # Two names for one thing share its probability.
        sure = None if sure is None else 0.5 * sure
        head = [
            replace(head[0], probability=sure),
            replace(head[0], probability=sure, effect=judgement.renamed[0]),
        ]
    found = {(c.effect, c.location): c for c in made}
    for rival, twin, chance in zip(judgement.rivals, judgement.twins, judgement.chances, strict=True):
        item = found[rival.name, rival.location]
        if twin is None:
            head.append(replace(item, probability=chance))
        else:
            head += [replace(item, probability=0.5 * chance, effect=name) for name in (item.effect, twin)]
    known = {(c.effect, c.location) for c in head}
    rest = [c for c in made if (c.effect, c.location) not in known]
    return tuple((head + rest)[:_LISTED]), len(head) if judgement.verdict == "ambiguous" else 0
