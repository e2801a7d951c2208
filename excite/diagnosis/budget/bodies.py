"""Bodies in the model of the gap: of what the columns ask for, the nearest that can exist.

A fit of a body's ten parameters is free to put the centre of a gram half a metre away, and a part of them leaves
out what a real body would show elsewhere: other names then take it. So the ten are fitted as a body that can exist
(Wensing, Kim and Slotine 2018), in the company of all other terms, and enter the search as one column.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.evidence import nats_between, price_of
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.search import Search
from excite.diagnosis.effects.effect import Effect

# Share of a column's power below which what a model leaves of it is rounding: products of columns have 16 digits, and
# the inverse of the model's has lost half of them.
_ROUNDING = 1e-7


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
    told, estimate = _told(beside.model, whole)
    kept, size = list(whole.kept), len(effect.linear)
    information, value = np.diag(1.0 / effect.widths**2), np.zeros(size)
    information[np.ix_(kept, kept)] += told / np.outer(whole.scale, whole.scale)
    value[kept] = estimate * whole.scale
    target = information @ value
    found = effect.nearest_body(maker.context, location, information, target)
    return None if found is None else _along(whole, found)


def _told(model: Model, whole: Term) -> tuple[Array, Array]:
    """What rows tell of a body's free parameters beside a model's, ``(size, size)``, and the parameters ``(size,)``.

    As what is left with the body weighs the rows: beside all that it takes, what a body is like a priori would count.
    """
    terms = (*model.terms, whole)
    free = fit(Design(model.design.rows, terms), range(len(terms)), model.weight, left_out=False)
    first = free.layout.begin[-1]
    here, others = slice(first, first + whole.size), np.r_[0:first]
    inner, cross = free.normal[here, here] - np.diag(whole.precision), free.normal[others, here]
    left = inner - cross.T @ np.linalg.solve(free.normal[np.ix_(others, others)], cross)
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    # A difference of rounding errors may be less than nothing.
    kept = vectors[:, values > _ROUNDING * np.diag(inner).max()]
    return kept @ (kept.T @ left @ kept) @ kept.T, free.x[here]


def bodies_at(places: Iterable[tuple[Effect, str]], beside: Beside, maker: TermMaker) -> list[Term]:
    """The likeliest body at each link, beside a model."""
    made = (body(beside, maker, effect, link) for effect, link in places)
    return [term for term in made if term is not None]


def _along(whole: Term, direction: Array) -> Term | None:
    """The term of which only the size is left to be fitted, its parameters in fixed proportions."""
    x = direction[list(whole.kept)] / whole.scale
    columns = {j: block @ x[:, None] for j, block in whole.columns.items()}
    size = float(np.sqrt(sum(np.mean(block**2) for block in columns.values())))
    if not size > 0.0:
        return None
    columns = {j: block / size for j, block in columns.items()}
    return replace(whole, columns=columns, scale=np.array([1.0 / size]), direction=direction)


def bodies_again(search: Search, maker: TermMaker) -> Search:
    """A search whose model's bodies are the likeliest beside its other terms, or one body in the place of some of them.

    A constant or a spring that the model had at first has taken a part of a body's weight, a small body at a link
    another, and the body what was left.
    """
    made = _anew(search, maker)
    links = {(term.location, term.effect): term for term in search.design.terms if term.effect.is_body}
    for like in links.values():
        chosen = made.model.chosen
        bodies = [k for k in chosen if made.design.terms[k].effect.is_body]
        terms = made.design.terms
        here = {None, *like.columns}
        own = [k for k in chosen if terms[k].own in here and not terms[k].effect.is_body]
        weights = [k for k in own if _like_weight(terms[k])]
        all_but_begun = [k for k in own if k in weights or not terms[k].started]
        if not all_but_begun and len(bodies) < 2:
            continue
        groups = [all_but_begun, weights, *([k] for k in weights)]
        for group in groups:
            # The body takes another form without what it stood beside.
            bodies = [k for k in made.model.chosen if made.design.terms[k].effect.is_body]
            if set(group) <= set(made.model.chosen):
                made = _in_place_of(made, maker, like, [*bodies, *group]) or made
    return made


def _in_place_of(search: Search, maker: TermMaker, like: Term, group: Sequence[int]) -> Search | None:
    """One body at a link in the place of several terms; None where that says less than it spares."""
    rest = [k for k in search.model.chosen if k not in group]
    beside = Beside.of(fit(search.design, rest, search.model.weight, left_out=False))
    one = body(beside, maker, like.effect, like.location)
    if one is None:
        return None
    design = Design(search.design.rows, (*search.design.terms, one))
    model = fit(design, (*rest, len(design.terms) - 1), search.model.weight)
    spared = sum(price_of(search.design.terms[k], search.candidates) for k in group)
    spared += _unlikely(search.model) - price_of(one, search.candidates) - _unlikely(model)
    if nats_between(search.model, model) <= -spared:
        return None
    return replace(search, design=design, model=model, rivals={}, merits={})


def _unlikely(model: Model) -> float:
    """Nats against a model whose terms cancel each other: what each gives a joint is a priori as large as its gap.

    On a surgical arm a bias of twice the yaw axis's gap, against as much of a body's weight, is worth 6.6 nats.
    """
    use = model.design.rows.block >= 0
    gap = fit(model.design, (), left_out=False).power(model.design.fitted.together)[0]
    nats = 0.0
    for k in model.chosen:
        x = model.parameters(k)
        for j, block in model.design.terms[k].columns.items():
            nats += 0.5 * float(((block[use] @ x) ** 2).mean()) / float(gap[j])
    return nats


def _like_weight(term: Term) -> bool:
    """Whether a term is what the weight of a body may look like at one joint."""
    spans = set(term.effect.spans)
    return bool(term.effect.nameless) or (bool(spans) and spans <= {"q", "1"})


def _anew(search: Search, maker: TermMaker) -> Search:
    """The same model, each of its bodies the likeliest beside its other terms."""
    terms = list(search.design.terms)
    for k in search.model.chosen:
        if terms[k].effect.is_body:
            terms[k] = body(beside_others(search, k), maker, terms[k].effect, terms[k].location) or terms[k]
    design = Design(search.design.rows, tuple(terms))
    return replace(search, design=design, model=fit(design, search.model.chosen), rivals={}, merits={})


def likeliest_beside(search: Search, numbers: Sequence[int], maker: TermMaker) -> list[Term]:
    """Some terms of a search's model, each body of them the likeliest beside the others and nothing else.

    What else the model has may cancel a part of a body: without it the body would be another.

    Args:
        search: settled.
        numbers: of the terms.
        maker: of columns.
    """
    if set(numbers) == set(search.model.chosen):
        return list(search.model.terms)
    found = []
    for k in numbers:
        term = search.design.terms[k]
        if term.effect.is_body:
            others = [i for i in numbers if i != k]
            beside = Beside.of(fit(search.design, others, search.model.weight, left_out=False))
            term = body(beside, maker, term.effect, term.location) or term
        found.append(term)
    return found


def beside_others(search: Search, k: int) -> Beside:
    """A model's other terms; smaller bodies may have patched up the first, rough form of the largest."""
    model, terms = search.model, search.design.terms
    bodies = [i for i in model.chosen if terms[i].effect.is_body]
    left_out = set(bodies) if bodies and k == max(bodies, key=search.model.taken_by) else {k}
    others = [i for i in model.chosen if i not in left_out]
    return Beside.of(fit(model.design, others, model.weight, left_out=False))
