"""Effects that only the model of all of them shows, put into the equations after those found one by one."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from excite.diagnosis.answer.budget import Budget, Named
from excite.diagnosis.budget.reading import alone, explained, namable
from excite.diagnosis.budget.record import Found
from excite.diagnosis.budget.terms import Term
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.fitted_signs import signs_again
from excite.diagnosis.search.attribution import Attribution, Scored, Stage
from excite.diagnosis.search.hypotheses import Hypothesis, Search, at_rows
from excite.diagnosis.search.refinement import extended
from excite.diagnosis.search.scoring import Scorer
from excite.diagnosis.search.structured import structured_joints
from excite.diagnosis.search.verdict import Judgement


def joined(
    attribution: Attribution, judgement: Judgement, found: Found, budget: Budget, scorer: Scorer
) -> tuple[Attribution, Judgement]:
    """The attribution and its verdict with what the budget names beside it.

    Many effects at once hide each other from a search that goes one by one: it ends in unknown, or with the largest.

    Args:
        attribution: effects found one by one; none where the verdict is unknown.
        judgement: the verdict on them.
        found: the model of the gap.
        budget: its budget.
        scorer: merits of hypotheses.
    """
    if judgement.verdict == "none":
        return attribution, judgement
    named = namable(budget)
    unknown = judgement.verdict == "unknown"
    if unknown and not explained(budget, named):
        return attribution, judgement
    there = {(item.effect, item.location) for item in budget.named}
    accepted = attribution.accepted
    keys = {(item.name, item.location) for item in accepted}
    together = [n for n in budget.named if n in named or (alone(n) and (n.effect, n.location) in keys)]
    if len(together) > 1 and all(_is_there(item, there) for item in accepted):
        # Sizes that were searched while the others were missing have stood in for them.
        after = _with(attribution, (), together, found, scorer)
        if after is not None and _loss(after) <= _loss(attribution):
            return after, _judged(judgement, accepted, after, (), there, scorer)
    own = [k for k, item in enumerate(accepted) if _is_there(item, there)]
    near = [k for k, item in enumerate(accepted) if not _taken_for(item, named, budget)]
    for kept in (own, near):
        after = _with(attribution, kept, named, found, scorer)
        # What was found alone may say more than what the whole has in its place.
        if after is not None and (len(kept) == len(accepted) or _loss(after) <= _loss(attribution)):
            return after, _judged(judgement, accepted, after, kept, there, scorer)
    kept = list(range(len(accepted)))
    after = _with(attribution, kept, named, found, scorer)
    if after is None:
        return attribution, _both_there(judgement, attribution, there)
    return after, _judged(judgement, accepted, after, kept, there, scorer)


def _key(item: Scored) -> tuple[str, str]:
    return item.name, item.location


def _is_there(item: Scored, there: Set[tuple[str, str]]) -> bool:
    """Whether the model of all effects has an effect that was found alone; a body may be at another link."""
    if item.hypothesis.effect.is_body:
        return any(name == item.name for name, _ in there)
    return (item.name, item.location) in there


def _both_there(judgement: Judgement, attribution: Attribution, there: Set[tuple[str, str]]) -> Judgement:
    """The verdict without rivals that are there as well: what was fitted alone took the part of both."""
    accepted = attribution.accepted
    if not accepted or not _is_there(accepted[0], there):
        return judgement
    several = len(accepted) > 1 and all(_is_there(item, there) for item in accepted[:2])
    left = [] if several else list(range(len(judgement.rivals)))
    if len(left) == len(judgement.rivals):
        return judgement
    verdict = judgement.verdict
    if verdict == "ambiguous" and judgement.renamed[0] is None:
        verdict = "effect"
    return replace(judgement, verdict=verdict, rivals=(), twins=())


def _with(
    attribution: Attribution, kept: Sequence[int], named: Sequence[Named], found: Found, scorer: Scorer
) -> Attribution | None:
    """The attribution with what is named after the effects that are kept; None where nothing joins them."""
    terms = {term.key: term for term in found.search.model.terms}
    new = [item for item in named if not _known(item, [attribution.accepted[k] for k in kept], set(terms))]
    begun = _kept(attribution, kept, scorer.baseline)
    if begun is None:
        return None
    stages, current = begun
    for item in new:
        scored = _scored(item, terms[item.effect, item.location], current, scorer)
        if scored is None:
            continue
        others = attribution.stages[0].ranking if not stages else ()
        ranking = (scored, *(s for s in others if (s.name, s.location) != (scored.name, scored.location)))
        stages.append(Stage(Context(current), ranking, scored))
        current = extended(scored.hypothesis)
    if len(stages) == len(kept):
        return None
    current = signs_again(current)
    stages.append(Stage(Context(current), (), None))
    return replace(
        attribution,
        stages=tuple(stages),
        after=current.fit,
        final=current,
        floor=scorer.floor(current.fit),
    )


def _loss(attribution: Attribution) -> float:
    """What a fit makes small: the logarithms of the joints' deviations."""
    return float(np.log(attribution.after.sigma).sum())


def _kept(
    attribution: Attribution, kept: Sequence[int], first: Baseline
) -> tuple[list[Stage], Baseline] | None:
    """Stages of the effects that stay and the baseline with them, fitted anew where others have gone.

    None where one of them cannot be fitted without those.
    """
    stages = [stage for stage in attribution.stages if stage.accepted is not None]
    if len(kept) == len(stages):
        return stages, attribution.final
    made, current = list[Stage](), first
    for k in kept:
        old, context = attribution.accepted[k], Context(current)
        item = old.hypothesis
        again = Search(context, current.solver).try_at(item.effect, item.location, item.theta)
        if again is None:
            return None
        made.append(Stage(context, stages[k].ranking, replace(old, hypothesis=again)))
        current = extended(again)
    return made, current


def _judged(
    judgement: Judgement,
    before: Sequence[Scored],
    after: Attribution,
    kept: Sequence[int],
    there: Set[tuple[str, str]],
    scorer: Scorer,
) -> Judgement:
    """The verdict with the effects that joined those ``kept``; rivals of the first one stay if it does."""
    first, added = tuple(kept[:1]) == (0,), after.accepted[len(kept) :]
    known = {_key(item): places for item, places in zip(before, judgement.tied, strict=False)}
    names = tuple(
        item.hypothesis.effect.second_name(after.final, item.location, item.hypothesis.fit) for item in added
    )
    renamed = (*(judgement.renamed[k] for k in kept), *names)
    verdict = judgement.verdict
    if not first:
        verdict = "effect" if renamed[0] is None else "ambiguous"
    made = replace(
        judgement,
        verdict=verdict,
        rivals=judgement.rivals if first else (),
        twins=judgement.twins if first else (),
        tied=(
            *(judgement.tied[k] for k in kept),
            *(known.get(_key(item), (item.location,)) for item in added),
        ),
        renamed=renamed,
        structured=structured_joints(after, scorer.spectral),
    )
    return _both_there(made, after, there)


def _known(item: Named, accepted: Sequence[Scored], there: Set[tuple[str, str]]) -> bool:
    """Whether an effect was found already, there or, of what moves a link, at any link.

    Of two that look alike the one that was found may stand for the other, unless the model of all has both.
    """
    for other in accepted:
        effect = other.hypothesis.effect
        alike = () if (other.name, other.location) in there else effect.confusable_with
        if other.location == item.location and item.effect in {other.name, *alike}:
            return True
        if other.name == item.effect and effect.is_body:
            return True
    return False


def _taken_for(item: Scored, named: Sequence[Named], budget: Budget) -> bool:
    """Whether the model of all effects has another in the place of one that was found alone."""
    if any((other.effect, other.location) == (item.name, item.location) for other in budget.named):
        return False
    alike = item.hypothesis.effect.confusable_with
    return any(other.location == item.location and other.effect in alike for other in named)


def _scored(item: Named, term: Term, baseline: Baseline, scorer: Scorer) -> Scored | None:
    """A term of the model in the equations of what is modelled; None where it cannot be there."""
    context = Context(baseline)
    columns = at_rows(context, term.effect.shape(context, term.location, term.theta))
    fit = baseline.solver.fit(columns.extra, columns.offset, 6, term.effect.widths)
    made = Hypothesis(term.effect, term.location, term.theta, columns, fit, baseline)
    if not made.physical:
        return None
    (scored,) = scorer.scored(baseline.fit, [made])
    return replace(scored, evidence=item.nats)
