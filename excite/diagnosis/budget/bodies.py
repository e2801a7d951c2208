"""Bodies in the model of the gap: of what the columns ask for, the nearest that can exist.

A fit of a body's ten parameters is free to put the centre of a gram half a metre away, and a part of them leaves
out what a real body would show elsewhere: other names then take it. So the ten are fitted as a body that can exist
(Wensing, Kim and Slotine 2018), in the company of all other terms, and enter the search as one column.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.refine import Beside
from excite.diagnosis.budget.terms import Term, TermMaker
from excite.diagnosis.effects.effect import Effect


def body(beside: Beside, maker: TermMaker, effect: Effect, location: str) -> Term | None:
    """One column for the body at a link that says most beside a model; None where no body says anything.

    Args:
        beside: the model without it.
        maker: of columns.
        effect: whose linear parameters are a body's.
        location: the link.
    """
    whole = maker.make(effect, location, ())
    if whole is None:
        return None
    left, slope = beside.information(whole)
    kept, size = list(whole.kept), len(effect.linear)
    information, target = np.diag(1.0 / effect.widths**2), np.zeros(size)
    information[np.ix_(kept, kept)] += left / np.outer(whole.scale, whole.scale)
    target[kept] = slope / whole.scale
    found = effect.nearest_body(maker.context, location, information, target)
    return None if found is None else _along(whole, found)


def _along(whole: Term, direction: Array) -> Term | None:
    """The term of which only the size is left to be fitted, its parameters in fixed proportions."""
    x = direction[list(whole.kept)] / whole.scale
    columns = {j: block @ x[:, None] for j, block in whole.columns.items()}
    size = float(np.sqrt(sum(np.mean(block**2) for block in columns.values())))
    if not size > 0.0:
        return None
    columns = {j: block / size for j, block in columns.items()}
    return replace(whole, columns=columns, scale=np.array([1.0 / size]), direction=direction)
