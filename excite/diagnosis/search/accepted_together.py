"""Non-linear parameters of effects that were accepted one after the other, searched again beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.fitted_signs import signs_again
from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.hypotheses import Hypothesis, Search
from excite.diagnosis.search.refinement import extended, price

# A search with the other effects in the model has to lower the loss by so much.
_BETTER = 2e-3


def searched_together(
    first: Baseline, accepted: Sequence[Scored], current: Baseline
) -> tuple[list[Scored], Baseline]:
    """What was searched while a later effect was missing has stood in for it; with that one there it need not.

    Args:
        first: the baseline without any of them.
        accepted: the effects, in order.
        current: the baseline with all of them.

    Returns:
        The effects and the baseline with all of them; those given where no search lowers the loss.
    """
    start = first.with_signs(current.signs, current.samples.lead)
    start = start.updated(start.solver.fit()) if start.solver is not first.solver else first
    items = [scored.hypothesis for scored in accepted]
    moved = False
    for k, item in enumerate(items[:-1]):
        better = _searched_beside(start, item, (*items[:k], *items[k + 1 :]))
        if better is not None:
            items[k], moved = better, True
    if not moved:
        return list(accepted), current
    base, made = start, []
    for scored, item in zip(accepted, items, strict=True):
        found = Search(Context(base), base.solver).try_at(item.effect, item.location, item.theta)
        if found is None:
            return list(accepted), current
        made.append(replace(scored, hypothesis=found))
        base = extended(found)
    base = signs_again(base)
    if float(np.log(base.fit.sigma).sum()) >= float(np.log(current.fit.sigma).sum()):
        return list(accepted), current
    return made, base


def _searched_beside(base: Baseline, item: Hypothesis, others: Sequence[Hypothesis]) -> Hypothesis | None:
    """The effect with its non-linear parameters searched beside others; None where that gains nothing."""
    if not item.effect.searched:
        return None
    for other in others:
        found = Search(Context(base), base.solver).try_at(other.effect, other.location, other.theta)
        if found is None:
            return None
        base = extended(found)
    search = Search(Context(base), base.solver)
    now = search.try_at(item.effect, item.location, item.theta)
    if now is None:
        return None
    # It may have gone far, either way, to stand in for what was missing.
    best = min((search.refine(now, step=step) for step in (-1.0, 1.0)), key=price)
    return best if best.settled and price(best) < price(now) - _BETTER else None
