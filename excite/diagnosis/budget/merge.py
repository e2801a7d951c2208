"""Several terms of one joint replaced by one that says as much: rough ones may patch up each other's form."""

from __future__ import annotations

from collections.abc import Sequence

from excite.diagnosis.budget.evidence import merit
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.search import Search


def merge(search: Search) -> None:
    """One term for all that a joint has, where it says as much: several rough ones may patch up its form."""
    for joint in sorted({o for k in search.model.chosen if (o := search.design.terms[k].own) is not None}):
        group = [
            k
            for k in search.model.chosen
            if search.design.terms[k].own == joint and not search.design.terms[k].started
        ]
        if len(group) < 2:
            continue
        without = fit(search.design, [k for k in search.model.chosen if k not in group], search.model.weight)
        now = _worth(search, without, search.model, group)
        alone = [
            k
            for k in search.allowed(without)
            if search.design.terms[k].own == joint and search.design.terms[k].theta
        ]
        tried = [item for k in alone if (item := search.try_beside(without, k)) is not None]
        best = max(tried, key=lambda t: t.merit.score, default=None)
        if best is not None and best.merit.passes and best.merit.score >= now:
            search.model = best.model


def _worth(search: Search, without: Model, with_them: Model, group: Sequence[int]) -> float:
    """Nats of several terms together less their prices."""
    made = [merit(without, with_them, search.design.terms[k], search.candidates) for k in group]
    prices = sum(float(m.nats.sum()) - m.score for m in made)
    return float(made[0].nats.sum()) - prices
