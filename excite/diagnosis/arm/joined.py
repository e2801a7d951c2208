"""Effects that only the model of all of them shows, put into the equations after those found one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from excite.diagnosis.answer.budget import Budget, Named
from excite.diagnosis.budget.reading import explained, namable
from excite.diagnosis.budget.record import Found
from excite.diagnosis.budget.terms import Term
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.fitted_signs import signs_again
from excite.diagnosis.search.attribution import Attribution, Scored, Stage
from excite.diagnosis.search.hypotheses import Hypothesis, at_rows
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
    if judgement.verdict == "none" or attribution.stranger is not None:
        return attribution, judgement
    named = namable(budget)
    unknown = judgement.verdict == "unknown"
    if unknown and not explained(budget, named):
        return attribution, judgement
    terms = {term.key: term for term in found.search.model.terms}
    new = [item for item in named if not _known(item, attribution.accepted)]
    stages = [stage for stage in attribution.stages if stage.accepted is not None]
    current = attribution.final
    for item in new:
        scored = _scored(item, terms[item.effect, item.location], current, scorer)
        if scored is None:
            continue
        others = attribution.stages[0].ranking if not stages else ()
        ranking = (scored, *(s for s in others if (s.name, s.location) != (scored.name, scored.location)))
        stages.append(Stage(Context(current), ranking, scored))
        current = extended(scored.hypothesis)
    if len(stages) == len(attribution.accepted):
        return attribution, judgement
    current = signs_again(current)
    stages.append(Stage(Context(current), (), None))
    after = replace(
        attribution,
        stages=tuple(stages),
        after=current.fit,
        final=current,
        floor=scorer.floor(current.fit),
    )
    return after, _judged(judgement, after, len(attribution.accepted), scorer)


def _judged(judgement: Judgement, after: Attribution, before: int, scorer: Scorer) -> Judgement:
    """The verdict with the effects that joined the first ``before``; rivals of the first one stay as they were."""
    added = after.accepted[before:]
    renamed = tuple(
        item.hypothesis.effect.second_name(after.final, item.location, item.hypothesis.fit) for item in added
    )
    verdict = judgement.verdict
    if verdict == "unknown":
        verdict = "effect" if renamed[0] is None else "ambiguous"
    return replace(
        judgement,
        verdict=verdict,
        tied=(*judgement.tied, *((item.location,) for item in added)),
        renamed=(*judgement.renamed, *renamed),
        structured=structured_joints(after, scorer.spectral),
    )


def _known(item: Named, accepted: Sequence[Scored]) -> bool:
    """Whether an effect was found already, there or, of what moves a link, at any link."""
    for other in accepted:
        effect = other.hypothesis.effect
        if other.location == item.location and item.effect in {other.name, *effect.confusable_with}:
            return True
        if other.name == item.effect and effect.is_body:
            return True
    return False


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
