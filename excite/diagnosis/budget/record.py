"""The model of the gap of a record: columns made, searched, made again at what was found, and searched again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.bodies import beside_others, bodies_again, bodies_at
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design, Rows, blocks_of
from excite.diagnosis.budget.fit.joint_fit import fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library, with_begun
from excite.diagnosis.budget.likely import likely_beside
from excite.diagnosis.budget.merge import merge
from excite.diagnosis.budget.polish.polisher import Polisher
from excite.diagnosis.budget.prediction import Prediction, predicted, signs_beside
from excite.diagnosis.budget.refine import Refiner
from excite.diagnosis.budget.search import Search
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.own_columns import COULOMB, own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples

# Share of what is left at its place that an effect of the first search has to take: small ones patch up what a large
# one leaves at its first, rough parameters.
_LARGE = 0.3
# Of what might stand in a term's place, how many have their non-linear parameters searched as well.
_INSTEAD = 2
# Joints at which resonances are searched, and how far above the noise they have to stand [power].
_RESONANT, _STANDS = 3, 1.5
# How often a resonance is searched again on what is fitted with it, and the nats that have to be in it.
_AGAIN, _PROMISES = 3, 10.0
# Passes after which the last terms stand: two whose places differ by rounding could go on.
_PASSES = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A model of the gap.

    Attributes:
        search: the last search, with its design and rivals.
        baseline: what every model begins with, fitted.
        prediction: its torques.
        likely: what would explain most if it stood alone, best first.
    """

    search: Search
    baseline: Baseline
    prediction: Prediction
    likely: tuple[Term, ...] = ()


def begun_baseline(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> Baseline:
    """What every model of a record begins with: what is modelled, and friction and constants whether or not."""
    return fit_baseline(samples, with_begun(modelled), floor)


def model_of_gap(
    full: Baseline,
    modelled: tuple[str, ...],
    effects: tuple[Effect, ...],
    floor: Array,
) -> Found:
    """Search for the model of a record's gap.

    Args:
        full: what every model begins with, fitted (:func:`begun_baseline`).
        modelled: words of ``modelled``.
        effects: that may be named.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    library, rows = Library(modelled, effects), rows_of(full, modelled, floor)
    maker = TermMaker(Context(full), full.strict)
    kept: list[Term] = []
    near: list[Term] = []
    likely: tuple[Term, ...] = ()
    candidates, steps = library.candidates(maker), [_LARGE, 0.0]
    while steps:
        least = steps.pop(0)
        begun = library.begun(maker)
        pruned = {t.key for t in begun} - {t.key for t in kept} if least == 0.0 else set()
        first = [*begun, *(t for t in kept if not t.started)]
        chosen = [k for k, term in enumerate(first) if term.key not in pruned]
        beside = Beside.of(fit(Design(rows, tuple(first)), chosen, left_out=False))
        bodies = bodies_at(library.bodies(maker.context), beside, maker)
        design = Design(rows, (*first, *candidates, *bodies, *near))
        search = Search(design, maker.context, fit(design, chosen), COULOMB.asked(modelled), least)
        likely = likely or likely_beside(search)
        # A body that was missing has bent what friction looked like: nothing else is sought beside it as yet.
        search.stops = least > 0.0 and not kept
        search.run()
        steps = [_LARGE, *steps] if search.stopped else steps
        if least > 0.0:
            full = signs_beside(full, search.model)
            rows = rows_of(full, modelled, floor)
        kept, near = _refined(full, search, library, resonances=least > 0.0)
    last, full = _settled(full, search, kept, near, library)
    return Found(last, full, predicted(full, last.model), likely)


def _settled(
    full: Baseline, search: Search, kept: list[Term], near: list[Term], library: Library
) -> tuple[Search, Baseline]:
    """The terms found, at their best parameters together, judged once more beside each other."""
    state = Polisher(library).polished(full, search.design.rows, kept)
    maker = TermMaker(Context(state.full), state.full.strict)
    begun = [t for t in library.begun(maker) if t.key not in {k.key for k in kept}]
    design = Design(state.rows, (*state.terms, *begun, *near))
    model = fit(design, range(len(kept)))
    last = Search(design, state.prediction.context, model, search.dry_given, tried=search.candidates)
    last.backward()
    merge(last)
    if any(term.effect.is_body for term in last.model.terms):
        last = bodies_again(last, TermMaker(last.context, state.full.strict))
        last.forward()
    last.settles = True
    # A term that took another's place has its own rivals.
    for _ in range(_PASSES):
        before = last.model.chosen
        last.backward()
        if last.model.chosen == before:
            break
    return last, state.full


def _refined(
    full: Baseline, search: Search, library: Library, *, resonances: bool
) -> tuple[list[Term], list[Term]]:
    """Accepted terms at better non-linear parameters, and what might stand in their places at its best."""
    model, terms = search.model, search.model.design.terms
    now = predicted(full, model)
    maker = TermMaker(now.context, full.strict)
    kept: list[Term] = []
    near: list[Term] = []
    for k in model.chosen:
        term = terms[k]
        if term.started:
            forms = _along(maker.context, term)
            if forms:
                term = replace(Refiner(maker).refined(beside_others(search, k), term, forms), started=True)
            kept.append(term)
            near += [terms[tried.index] for tried in search.rivals.get(k, ())]
            continue
        own = TermMaker(now.without(k), full.strict)
        beside = beside_others(search, k)
        near += [terms[tried.index] for tried in search.rivals.get(k, ())]
        if term.effect.is_body:
            made = bodies_at(library.bodies(own.context), beside, own)
            kept.append(next((t for t in made if t.key == term.key), term))
            near += [t for t in made if t.key != term.key]
            continue
        again = own.again(term) or term
        if not (term.theta or term.effect.richer):
            kept.append(again)
            continue
        refiner = Refiner(own)
        kept.append(refiner.refined(beside, again, term.effect.richer, closer=not resonances))
        others = [i for i in model.chosen if i != k]
        neighbours = [i for i in others if terms[i].own == term.own and not terms[i].started]
        if term.own is not None and neighbours:
            alone = [i for i in others if i not in neighbours]
            apart = Beside.of(fit(model.design, alone, model.weight, left_out=False))
            near.append(refiner.refined(apart, again, term.effect.richer))
        for other in search.instead(k, beside.model)[:_INSTEAD]:
            near.append(refiner.refined(beside, terms[other], terms[other].effect.richer))
    if resonances:
        near += [_with_its_swing(full, search, term) for term in _resonances(search, Refiner(maker))]
    return kept, near


def _along(context: Context, term: Term) -> list[Effect]:
    """Richer forms of what the model begins with that have another effect in them, where they can be."""
    forms = [form for form in term.effect.richer if form.along]
    return [
        form
        for form in forms
        if form.admissible(context, term.location, form.starts(term.theta)[0], np.ones(len(form.linear)))
    ]


def _resonances(search: Search, refiner: Refiner) -> list[Term]:
    """Effects with several non-linear parameters at the joints that have most left: no grid finds a resonance."""
    model = search.model
    beside, floor = Beside.of(model), model.design.rows.floor
    use = model.design.rows.block >= 0
    left = (model.residual[:, use] ** 2).mean(axis=1) / floor**2
    worst = [j for j in np.argsort(-left)[:_RESONANT] if left[j] > _STANDS]
    best: dict[tuple[str, str], tuple[float, Term]] = {}
    keys = {term.key for term in model.terms}
    # Gears were given the load of a robot without what moves it otherwise: a tilt, another body.
    moved = any(term.effect.moves for term in model.terms)
    for like in model.design.terms:
        if like.own not in worst or len(like.theta) < 2 or like.key in keys:
            continue
        term = (refiner.maker.again(like) or like) if moved else like
        gain = beside.gain(term)[0]
        if term.key not in best or gain > best[term.key][0]:
            best[term.key] = (gain, term)
    made = [refiner.refined(beside, term) for _, term in best.values()]
    return made + [found for _, term in best.values() for found in refiner.unlike(beside, term)]


def _with_its_swing(full: Baseline, search: Search, term: Term) -> Term:
    """A gear's play or softness searched again on what is fitted with it, as long as that gains.

    It takes the load from the rigid bodies, which its swinging has bent while nobody knew of it.
    """
    model = search.model
    beside, terms = Beside.of(model), [*model.terms, term]
    gain = beside.gain(term)[0]
    for _ in range(_AGAIN if gain > _PROMISES else 0):
        design = Design(model.design.rows, (*terms[:-1], term))
        now = predicted(full, fit(design, range(len(terms)), model.weight, left_out=False))
        own = TermMaker(now.without(len(terms) - 1), full.strict)
        made = own.again(term)
        found = term if made is None else Refiner(own).refined(beside, made)
        more = beside.gain(found)[0]
        if more <= gain + _PROMISES:
            break
        term, gain = found, more
    return term


def rows_of(full: Baseline, modelled: tuple[str, ...], floor: Array) -> Rows:
    """Weighted rows of what is modelled."""
    samples, weight = full.samples, full.strict
    e = full.solver.equations
    again = weight / full.root_weight
    terms = own_terms(modelled)
    own = []
    for j, sign in enumerate(full.signs):
        columns = own_signals(samples, terms, j, sign)
        own.append(
            samples.rows(columns) * weight[j][:, None] if columns.shape[1] else np.zeros((e.y.shape[1], 0))
        )
    outside = not samples.identification.all()
    block = blocks_of(samples, identification=True)
    judged = blocks_of(samples, identification=False) if outside else block
    return Rows(
        e.shared * again[:, :, None], tuple(own), e.y * again, block, judged, samples.trial_of_row, floor
    )
