"""Scored hypotheses as they stand in the document: with their values, what they close, and how likely they are."""

from __future__ import annotations

from dataclasses import replace

from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap, share_closed
from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.attribution.judgement import Judgement
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.units import at_joint
from excite.diagnosis.simulator.found import Found

_LISTED = 8


def candidate_of(
    item: Scored, context: Context, gap: Gap, attribution: Attribution, tied: tuple[str, ...] = ()
) -> Candidate:
    """A scored hypothesis as it stands in the document; gaps on the validation trials."""
    h = item.hypothesis
    after = h.baseline.gap(h.fit.residual, attribution.scale)
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


def beside_others(item: Candidate, found: Found) -> Candidate:
    """An accepted effect with the values that it has beside all others, not those when it was alone."""
    values = {
        name: replace(estimate, value=found.values.get(name, estimate.value))
        for name, estimate in item.parameters.items()
    }
    return replace(item, parameters=values)


def by_blocks(item: Candidate, budget: Budget) -> Candidate:
    """An accepted effect as the model of all effects has it: its probability, and no smaller deviations.

    Those are the deviations between blocks left out.

    Formulas know the noise and not what the model lacks: of a ball screw's offset one says ±0.05 N that is 0.24 N off.
    """
    values, chance = dict(item.parameters), item.probability
    for other in budget.named:
        if (other.effect, other.location) != (item.effect, item.location):
            continue
        chance = other.probability
        for name, (_, std) in other.values.items():
            if name in values and std is not None and std > (values[name].std or 0.0):
                values[name] = replace(values[name], std=std)
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
