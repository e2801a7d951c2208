"""Non-linear parameters of a term searched between those of the grid, in the joint fit with all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.diagnosis.budget.bodies import beside_others, bodies_at
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.rivals import terms_of
from excite.diagnosis.budget.screening import one_each, screened
from excite.diagnosis.budget.search import Search, predicted
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.progress import step

# Factors between neighbouring values, first and last, and how many of a kind are tried.
_FIRST, _LAST, _MOST = 1.5, 1.01, 40
# Values after which a search that has gained nothing ends: gears that are not there only grow stiffer. Of three arms
# with a little of everything no name was another with 40.
_HOPELESS = 8
# Nats by which a form with more parameters has to lead, odds of 20 to 1, and one more for each of them.
RICHER = 3.0
# Of what might stand in a term's place, how many have their non-linear parameters searched as well.
_INSTEAD = 2
# Joints at which resonances are searched, and how far above the noise they have to stand [power].
_RESONANT, _STANDS = 3, 1.5
# How often a resonance is searched again on what is fitted with it, and the nats that have to be in it.
_AGAIN, _PROMISES = 3, 10.0


@dataclass(eq=False)
class Refiner:
    """Searches non-linear parameters.

    Attributes:
        maker: makes the columns.
    """

    maker: TermMaker

    def refined(
        self, beside: Beside, term: Term, forms: Sequence[Effect] = (), *, closer: bool = False
    ) -> Term:
        """The term at better parameters, or in a richer form where that is worth its parameters.

        Args:
            beside: the model without it.
            term: where to begin.
            forms: richer forms.
            closer: whether to try it with what its first order leaves out.
        """
        best, gain = self._searched(beside, term)
        for form in forms:
            for start in form.starts(best.theta)[:3]:
                begun = self._made(form, term, start)
                # A form that begins where it cannot be ends there as well.
                if begun is None or not begun.admissible(self.maker.context, beside.gain(begun)[1]):
                    continue
                item, more = self._searched(beside, begun)
                if beside.between(best, item) > RICHER + (item.n_parameters - best.n_parameters):
                    best, gain = item, more
        # Of a torque that is 12 ms late a secant over 20 ms says 17 nats more than all of it so late, at a size that no
        # delay of 20 ms has: it smooths the encoders' noise. Such a size was lost at the end, and the delay with it.
        stands_in = best.effect.stands_in
        whole = best.effect.closer if closer or stands_in else None
        begun = None if whole is None else self._made(whole, best, best.theta)
        if begun is not None:
            item, more = self._searched(beside, begun)
            best = item if more > (0.0 if stands_in else gain) else best
        return best

    def unlike(self, beside: Beside, term: Term) -> list[Term]:
        """Richer forms that begin far from where the plain one does, each at its best."""
        found = []
        for form in term.effect.richer:
            starts = form.own_starts(self.maker.context, term.location)
            begun = [t for t in (self._made(form, term, start) for start in starts) if t is not None]
            gains = [beside.gain(term)[0] for term in begun]
            if max(gains, default=0.0) > 0.0:
                found.append(self._searched(beside, begun[int(np.argmax(gains))])[0])
        return found

    def _searched(self, beside: Beside, term: Term) -> tuple[Term, float]:
        """Steps on a logarithmic scale, one parameter after the other, the steps ever smaller."""
        best, gain = term, beside.gain(term)[0]
        step, tried, seen = _FIRST, 0, {_rounded(term.theta)}
        while step > _LAST and term.theta and tried < _MOST:
            moved = False
            for i, parameter in enumerate(term.effect.searched):
                for way in (step, 1.0 / step):
                    value = best.theta[i] * way
                    if not parameter.low <= value <= parameter.high:
                        continue
                    theta = (*best.theta[:i], value, *best.theta[i + 1 :])
                    tried += 1
                    # Shorter steps come back to where longer ones were: what was no better then is none now.
                    if _rounded(theta) in seen:
                        continue
                    seen.add(_rounded(theta))
                    item = self._made(term.effect, term, theta)
                    if item is None:
                        continue
                    new, x = beside.gain(item)
                    if new > gain + 1e-3 and item.admissible(self.maker.context, x):
                        best, gain, moved = item, new, True
                        break
            if gain <= 0.0 and tried >= _HOPELESS:
                break
            step = step if moved else step**0.5
        return best, gain

    def _made(self, effect: Effect, like: Term, theta: Theta) -> Term | None:
        whole = len(like.kept) == len(like.effect.linear) or effect is not like.effect
        return self.maker.make(effect, like.location, theta, None if whole else like.kept)


def _rounded(theta: Theta) -> tuple[str, ...]:
    """The same for parameters that differ by rounding alone."""
    return tuple(f"{value:.9e}" for value in theta)


@step("refine effects")
def refined_terms(
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
            near += terms_of(search.rivals.get(k, ()), terms)
            continue
        own = TermMaker(now.without(k), full.strict)
        beside = beside_others(search, k)
        near += terms_of(search.rivals.get(k, ()), terms)
        if term.effect.is_body:
            made = bodies_at(library.bodies(own.context), beside, own)
            # A body of some trials and one of all have the same name.
            same = [t.key == term.key and t.effect is term.effect for t in made]
            kept.append(next((t for t, it in zip(made, same, strict=True) if it), term))
            near += [t for t, it in zip(made, same, strict=True) if not it]
            continue
        again = own.again(term) or term
        if not (term.theta or term.effect.richer):
            kept.append(again)
            continue
        refiner = Refiner(own)
        found = refiner.refined(beside, again, term.effect.richer, closer=not resonances)
        kept.append(found)
        near += _mirrored(own, found)
        others = [i for i in model.chosen if i != k]
        neighbours = [i for i in others if terms[i].own == term.own and not terms[i].started]
        if term.own is not None and neighbours:
            alone = [i for i in others if i not in neighbours]
            apart = Beside.of(fit(model.design, alone, model.weight, left_out=False))
            near.append(refiner.refined(apart, again, term.effect.richer))
        for other in _instead(search, k, beside.model)[:_INSTEAD]:
            near.append(refiner.refined(beside, terms[other], terms[other].effect.richer))
    if resonances:
        near += [_with_its_swing(full, search, term) for term in _resonances(search, Refiner(maker))]
    return kept, near


def _instead(search: Search, k: int, without: Model) -> list[int]:
    """Other effects with non-linear parameters that might stand in a term's place, likeliest first."""
    terms = search.design.terms
    allowed = [i for i in search.allowed(without) if terms[i].key != terms[k].key]
    ranking = [s for s in screened(without, allowed) if search.can_be(s.index, s.x)]
    near = [s.index for s in one_each(search.design, ranking) if s.joint == terms[k].own]
    return [i for i in near if terms[i].theta and not terms[i].started]


def _mirrored(maker: TermMaker, term: Term) -> list[Term]:
    """What says about the same as a term where bodies are free to take up the rest."""
    other = term.effect.mirrored(maker.context, term.location, term.theta)
    made = None if other is None else maker.make(other[0], term.location, other[1])
    return [] if made is None else [made]


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
    # Gears were given the load of the first fit: one without a tilt or another body, of bodies that the gap has bent.
    for like in model.design.terms:
        if like.own not in worst or len(like.theta) < 2 or like.key in keys:
            continue
        term = refiner.maker.again(like) or like
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
