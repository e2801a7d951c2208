"""Effects that the model of the gap names, put into the equations one after the other, the largest first."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.budget import Budget, Named
from excite.diagnosis.answer.result import Verdict
from excite.diagnosis.budget.reading import Reading, read
from excite.diagnosis.budget.record import Found
from excite.diagnosis.budget.terms import Term
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.fitted_signs import signs_again
from excite.diagnosis.search.accepted_together import searched_together
from excite.diagnosis.search.attribution import Attribution, Scored, Stage
from excite.diagnosis.search.hypotheses import Hypothesis, at_rows
from excite.diagnosis.search.refinement import extended, polished
from excite.diagnosis.search.scoring import Scorer
from excite.diagnosis.search.structured import structured_joints
from excite.diagnosis.search.verdict import Judgement


@dataclass(frozen=True, eq=False)
class Read:
    """What the model of the gap says, in the equations of what is modelled.

    Attributes:
        attribution: the named effects, one after the other.
        judgement: the verdict and what is open.
        reading: of the budget.
    """

    attribution: Attribution
    judgement: Judgement
    reading: Reading


def attributed(baseline: Baseline, scorer: Scorer, found: Found, budget: Budget, spectral: Array) -> Read:
    """Put what the budget names into the equations.

    Args:
        baseline: what is modelled, fitted.
        scorer: merits of hypotheses.
        found: the model of the gap.
        budget: its budget.
        spectral: ``(n_joints,)`` noise in the rows' band.
    """
    everything = _chain(baseline, scorer, found, budget.named)
    structured = structured_joints(everything, spectral)
    first = everything.accepted[0] if everything.accepted else None
    second = None if first is None else _second_name(first, everything.final)
    reading = read(budget, structured, open_name=second is not None)
    if not reading.effects:
        attribution = _chain(baseline, scorer, found, ())
        places = structured if reading.place is None else (reading.place, *structured)
        return Read(
            attribution, Judgement(reading.verdict, (), (), (), tuple(dict.fromkeys(places))), reading
        )
    attribution = _chain(baseline, scorer, found, reading.effects, finer=True)
    structured = structured_joints(attribution, spectral)
    tied = tuple(
        (item.location, *(place for name, place in item.rivals if name == item.effect))
        for item in reading.effects
    )
    renamed = tuple(_second_name(item, attribution.final) for item in attribution.accepted)
    rivals = attribution.stages[0].ranking[1:] if reading.verdict == "ambiguous" else ()
    rivals = tuple(r for r in rivals if r.name != attribution.accepted[0].name)
    twins = tuple(_second_name(item, attribution.final) for item in rivals)
    verdict: Verdict = "ambiguous" if rivals or renamed[0] is not None else "effect"
    judgement = Judgement(verdict, rivals, tied, renamed, structured, 1.0, twins)
    return Read(attribution, judgement, reading)


def _chain(
    baseline: Baseline, scorer: Scorer, found: Found, named: tuple[Named, ...], *, finer: bool = False
) -> Attribution:
    """The attribution of named effects, in their order; the first one's rivals are ranked after it."""
    terms = {term.key: term for term in found.search.model.terms}
    rivals = {
        found.search.model.design.terms[k].key: [found.search.design.terms[t.index] for t in tried]
        for k, tried in found.search.rivals.items()
    }
    current, stages = baseline, []
    for number, item in enumerate(named):
        key = (item.effect, item.location)
        others = rivals.get(key, []) if number == 0 else []
        made = [_hypothesis(term, current) for term in (terms[key], *others)]
        if finer and item.share >= THRESHOLDS.trifle and terms[key].theta:
            made[0] = polished(made[0])
        scored = [
            replace(s, evidence=nats)
            for s, nats in zip(
                scorer.scored(current.fit, made), (item.nats, *_nats(found, key)), strict=False
            )
        ]
        stages.append(Stage(Context(current), tuple(scored), scored[0]))
        current = extended(scored[0].hypothesis)
    current = signs_again(current) if named else current
    if finer and len(stages) > 1:
        items, current = searched_together(baseline, [s.accepted for s in stages if s.accepted], current)
        stages = [replace(s, accepted=item) for s, item in zip(stages, items, strict=True)]
    stages.append(Stage(Context(current), (), None))
    return Attribution(
        tuple(stages), baseline.fit, current.fit, current, scorer.floor(current.fit), scorer.scale
    )


def _nats(found: Found, key: tuple[str, str]) -> list[float]:
    """Nats of an effect's rivals."""
    search = found.search
    index = next(k for k in search.model.chosen if search.design.terms[k].key == key)
    return [item.merit.score for item in search.rivals.get(index, [])]


def _hypothesis(term: Term, baseline: Baseline) -> Hypothesis:
    """A term of the model in the equations of what is modelled."""
    context = Context(baseline)
    columns = at_rows(context, term.effect.shape(context, term.location, term.theta))
    widths = term.effect.widths
    if columns.extra is not None and len(term.kept) < len(term.effect.linear):
        # What the motion does not show of it is none.
        widths = np.where(np.isin(np.arange(len(widths)), term.kept), widths, 1e-9)
    fit = baseline.solver.fit(columns.extra, columns.offset, 6, widths)
    return Hypothesis(term.effect, term.location, term.theta, columns, fit, baseline)


def _second_name(item: Scored, final: Baseline) -> str | None:
    """Another name that means the same in the data."""
    return item.hypothesis.effect.second_name(final, item.location, item.hypothesis.fit)
