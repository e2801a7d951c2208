"""Bodies in the model of the gap: of what the columns ask for, the nearest that can exist.

A fit of a body's ten parameters is free to put the centre of a gram half a metre away, and a part of them leaves
out what a real body would show elsewhere: other names then take it. So the ten are fitted as a body that can exist
(Wensing, Kim and Slotine 2018), in the company of all other terms, and enter the model as one column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.effects.effect import Effect

# Share of a column's power below which what a model leaves of it is rounding: products of columns have 16 digits, and
# the inverse of the model's has lost half of them.
_ROUNDING = 1e-7


def make_body_term(beside: Model, maker: TermMaker, effect: Effect, location: str) -> Term | None:
    """One column for the body at a link that says most beside a model; None where no body says anything.

    Args:
        beside: the model without it.
        maker: of columns.
        effect: whose linear parameters are a body's.
    """
    whole = maker.make_term(effect, location, ())
    if whole is None:
        return None
    told, estimate = _estimate_body(beside, whole)
    kept, size = list(whole.kept), len(effect.linear)
    information, value = np.diag(1.0 / effect.prior_widths**2), np.zeros(size)
    information[np.ix_(kept, kept)] += told / np.outer(whole.scale, whole.scale)
    value[kept] = estimate * whole.scale
    target = information @ value
    found = effect.nearest_body(maker.context, location, information, target)
    return None if found is None else _fix_direction(whole, found)


def _estimate_body(model: Model, whole: Term) -> tuple[Array, Array]:
    """What rows tell of a body's free parameters beside a model's, ``(size, size)``, and the parameters ``(size,)``.

    As what is left with the body weighs the rows: beside all that it takes, what a body is like a priori would count.
    """
    terms = (*model.terms, whole)
    free = fit_model(Design(model.design.rows, terms), range(len(terms)), model.weight, left_out=False)
    first = free.layout.begin[-1]
    here, others = slice(first, first + whole.n_free), np.r_[0:first]
    inner, cross = free.normal[here, here] - np.diag(whole.prior_precision), free.normal[others, here]
    left = inner - cross.T @ np.linalg.solve(free.normal[np.ix_(others, others)], cross)
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    # A difference of rounding errors may be less than nothing.
    kept = vectors[:, values > _ROUNDING * np.diag(inner).max()]
    return kept @ (kept.T @ left @ kept) @ kept.T, free.x[here]


def _fix_direction(whole: Term, direction: Array) -> Term | None:
    """The term of which only the size is left to be fitted, its parameters in fixed proportions."""
    x = direction[list(whole.kept)] / whole.scale
    columns = {j: block @ x[:, None] for j, block in whole.columns.items()}
    size = float(np.sqrt(sum(np.mean(block**2) for block in columns.values())))
    if not size > 0.0:
        return None
    columns = {j: block / size for j, block in columns.items()}
    return replace(whole, columns=columns, scale=np.array([1.0 / size]), direction=direction)


def fit_likeliest_bodies(model: Model, numbers: Sequence[int], maker: TermMaker) -> list[Term]:
    """Some terms of a model, each body of them the likeliest beside the others and nothing else.

    What else the model has may cancel a part of a body: without it the body would be another.

    Args:
        model: all terms, fitted.
        numbers: of the terms.
        maker: of columns.
    """
    found = []
    for k in numbers:
        term = model.design.terms[k]
        if term.effect.is_body:
            others = [i for i in numbers if i != k]
            beside = fit_model(model.design, others, model.weight, left_out=False)
            term = make_body_term(beside, maker, term.effect, term.location) or term
        found.append(term)
    return found
