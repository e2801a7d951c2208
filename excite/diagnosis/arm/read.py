"""The verdict on a record and its effects, read from the budget of its gap and put into the equations."""

from __future__ import annotations

from dataclasses import replace

from excite.diagnosis.answer.budget import Budget, Named
from excite.diagnosis.budget.reading import alone, clear, explained
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

# Candidates that are listed beside what was found.
_LISTED = 8


def read(found: Found, budget: Budget, scorer: Scorer) -> tuple[Attribution, Judgement]:
    """The effects that a budget names, in the equations, and the verdict on the record.

    Args:
        found: the model of the gap.
        budget: its budget.
        scorer: merits of hypotheses beside what is modelled.
    """
    base = scorer.baseline
    terms = {term.key: term for term in found.search.model.terms}
    nothing = Attribution(
        (Stage(Context(base), (), None),), base.fit, base.fit, base, scorer.floor(base.fit), scorer.scale
    )
    structured = structured_joints(nothing, scorer.spectral)
    sure = [item for item in budget.named if clear(budget, item)]
    likely = [term for term in found.likely if term.key not in terms]
    if not sure or not explained(budget, sure):
        verdict = "unknown" if structured else "none"
        tried = [*(terms[n.effect, n.location] for n in budget.named), *likely][:_LISTED]
        ranking = tuple(s for t in tried if (s := _scored(t, base, scorer)) is not None)
        stage = Stage(Context(base), ranking, None)
        stranger = None if verdict == "none" else _stranger(found, budget, scorer)
        if stranger is not None:
            structured = (stranger.location, *(j for j in structured if j != stranger.location))
        return replace(nothing, stages=(stage,), stranger=stranger), Judgement(
            verdict, (), (), (), structured
        )
    first, *others = sure
    chosen = [first, *(item for item in others if alone(item))]
    stages, current, kept = list[Stage](), base, list[Named]()
    for item in chosen:
        scored = _scored(terms[item.effect, item.location], current, scorer, item.nats)
        if scored is None:
            continue
        stages.append(Stage(Context(current), (scored,), scored))
        current = extended(scored.hypothesis)
        kept.append(item)
    if not kept:
        return nothing, Judgement("unknown", (), (), (), structured)
    current = signs_again(current)
    first = kept[0]
    k = next(
        k
        for k in found.search.model.chosen
        if found.search.design.terms[k].key == (first.effect, first.location)
    )
    near = [found.search.design.terms[t.index] for t in found.search.rivals.get(k, ())]
    near = [t for t in near if t.key not in terms]
    beside = [s for t in near if (s := _scored(t, base, scorer)) is not None]
    rivals = tuple(s for s in beside if s.name != first.effect)
    listed = [s for t in likely if (s := _scored(t, base, scorer)) is not None]
    stages[0] = replace(stages[0], ranking=(stages[0].accepted, *beside, *listed)[:_LISTED])
    stages.append(Stage(Context(current), (), None))
    after = replace(
        nothing, stages=tuple(stages), after=current.fit, final=current, floor=scorer.floor(current.fit)
    )
    renamed = tuple(
        s.hypothesis.effect.second_name(current, s.location, s.hypothesis.fit) for s in after.accepted
    )
    twins = tuple(s.hypothesis.effect.second_name(current, s.location, s.hypothesis.fit) for s in rivals)
    tied = tuple((item.location, *(p for n, p in item.rivals if n == item.effect)) for item in kept)
    verdict = "ambiguous" if rivals or renamed[0] is not None else "effect"
    return after, Judgement(
        verdict, rivals, tied, renamed, structured_joints(after, scorer.spectral), 1.0, twins
    )


def _stranger(found: Found, budget: Budget, scorer: Scorer) -> Scored | None:
    """Physics without a name that the model has and that takes more of its place than what has one."""
    for term in found.search.model.terms:
        if term.effect.nameless:
            scored = _scored(term, scorer.baseline, scorer)
            if scored is not None:
                return scored
    return None


def _scored(term: Term, baseline: Baseline, scorer: Scorer, nats: float | None = None) -> Scored | None:
    """A term of the model in the equations of what is modelled; None where it cannot be there."""
    context = Context(baseline)
    columns = at_rows(context, term.effect.shape(context, term.location, term.theta))
    fit = baseline.solver.fit(columns.extra, columns.offset, 6, term.effect.widths)
    made = Hypothesis(term.effect, term.location, term.theta, columns, fit, baseline)
    if not made.physical:
        return None
    (scored,) = scorer.scored(baseline.fit, [made])
    return scored if nats is None else replace(scored, evidence=nats)
