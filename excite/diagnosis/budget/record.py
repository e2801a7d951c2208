"""The model of the gap of a record: columns made, searched, made again at what was found, and searched again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.bodies import bodies_again, bodies_at
from excite.diagnosis.budget.evidence import LARGE, merit
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design, Rows, blocks_of
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library, with_begun
from excite.diagnosis.budget.polish import Polisher, without_noise
from excite.diagnosis.budget.refine import refined_terms
from excite.diagnosis.budget.screening import one_each, screened
from excite.diagnosis.budget.search import Prediction, Search, predicted, signs_beside
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import COULOMB, own_rows, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standstill import fit_where_slipping
from excite.progress import step

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


@step("fit what is modelled")
def begun_baseline(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> Baseline:
    """What every model of a record begins with: what is modelled, and friction and constants whether or not."""
    return fit_where_slipping(samples, with_begun(modelled), floor)


def model_of_gap(
    full: Baseline,
    modelled: tuple[str, ...],
    effects: tuple[Effect, ...],
    floor: Array,
    sigma: Array | None = None,
) -> Found:
    """Search for the model of a record's gap.

    Args:
        full: what every model begins with, fitted (:func:`begun_baseline`).
        modelled: words of ``modelled``.
        effects: that may be named.
        floor: ``(n_joints,)`` noise in the rows' band.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad]; None for none.
    """
    library, rows = Library(modelled, effects), rows_of(full, modelled, floor)
    maker = TermMaker(Context(full), full.strict)
    kept: list[Term] = []
    near: list[Term] = []
    likely: tuple[Term, ...] = ()
    candidates, steps = library.candidates(maker), [LARGE, 0.0]
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
        steps = [LARGE, *steps] if search.stopped else steps
        if least > 0.0:
            full = signs_beside(full, search.model)
            rows = rows_of(full, modelled, floor)
        kept, near = refined_terms(full, search, library, resonances=least > 0.0)
        if steps and (loads := _other_loads(full, search)) is not None:
            # A share of what a found body alone asks for would be a part of that body.
            told = {term.key for term in candidates}
            again = library.candidates(TermMaker(loads, full.strict))
            candidates = [term for term in again if term.key in told]
    last, full = _settled(full, search, kept, near, library)
    if sigma is not None:
        without_noise(last, full, sigma, np.random.default_rng(0))
    return Found(last, full, predicted(full, last.model), likely)


@step("weigh effects together")
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


def _other_loads(full: Baseline, search: Search) -> Context | None:
    """Predictions with bodies and geometry that were found, whose load what grows with it needs; None without any.

    Not with gears: of a load that a soft gear has made of itself a torque gain at its joint explains that gear.
    """
    model, terms = search.model, search.design.terms
    gears = [k for k in model.chosen if terms[k].known]
    if not any(terms[k].effect.moves for k in model.chosen if k not in gears):
        return None
    return predicted(full, model).without(*gears)


def rows_of(full: Baseline, modelled: tuple[str, ...], floor: Array) -> Rows:
    """Weighted rows of what is modelled."""
    samples, weight = full.samples, full.strict
    e = full.solver.equations
    again = weight / full.root_weight
    terms = own_terms(modelled)
    own = [own_rows(samples, terms, j, [sign])[0] * weight[j][:, None] for j, sign in enumerate(full.signs)]
    outside = not samples.identification.all()
    block = blocks_of(samples, identification=True)
    judged = blocks_of(samples, identification=False) if outside else block
    return Rows(
        e.shared * again[:, :, None], tuple(own), e.y * again, block, judged, samples.trial_of_row, floor
    )


# What is likely by itself: effects that would explain most if nothing else were there.

# Effects that are listed.
_LISTED = 8


def likely_beside(search: Search) -> tuple[Term, ...]:
    """Terms with a name that would gain most beside a search's model, best first."""
    ranking = one_each(search.design, screened(search.model, search.allowed(search.model)))
    terms = (search.design.terms[item.index] for item in ranking)
    return tuple(islice((term for term in terms if not term.effect.nameless), _LISTED))


# Several terms of one joint replaced by one that says as much: rough ones may patch up each other's form.


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
