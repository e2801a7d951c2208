"""All effects at all places, as one more beside those that are accepted already."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, links
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS, FURTHER_FORMS
from excite.diagnosis.floating.effects.unlogged_contact import UnloggedContact
from excite.diagnosis.floating.equations.contact_times import find_contact
from excite.diagnosis.floating.equations.problem import Problem, build_problem
from excite.diagnosis.floating.equations.surfaces import find_surfaces, pressed
from excite.diagnosis.floating.search.refinement import (
    Fitted,
    Placed,
    explained_state,
    judged_by,
    linearised,
    refine,
)
from excite.diagnosis.floating.search.screening import Screened, effect_columns, screen

# Nats by which evidence must differ before one hypothesis is preferred (odds of 150 to 1).
DECISIVE = 5.0
# Power over the expected noise that repeated trials, which set it, leave open.
NOISE_SLACK = 1.5
_FIRST_LOOK, _PER_EFFECT, _NEIGHBOURS, _FURTHER = 6, 1, 14, 3
# Share of the best linearised gain below which no iteration will bring a hypothesis to the top.
_WORTH_A_LOOK = 0.2
# How far behind the leading one, in decisive steps, a hypothesis is fitted to all samples.
_LEADING = 4.0


@dataclass(frozen=True, eq=False)
class Ranked:
    """A refined hypothesis among its rivals.

    Attributes:
        fitted: the fit.
        evidence: log Bayes factor, for noise as large as the best hypothesis leaves, places paid for [nats].
        choice: what the number of places costs [nats].
    """

    fitted: Fitted
    evidence: float
    choice: float = 0.0

    @property
    def last(self) -> Placed:
        """The effect that it adds."""
        return self.fitted.placed[-1]


class Ranker:
    """Ranks what may come next to effects that are accepted; for the same effects it is asked again and again.

    Attributes:
        problem: the problem.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self._coarse = build_problem(problem.record.thinned())
        self._known: dict[tuple[tuple[FloatingEffect, str], ...], tuple[Ranked, ...]] = {}

    def __call__(self, current: Fitted) -> tuple[Ranked, ...]:
        """All effects at all places added to ``current``, best evidence first (:func:`rank_next`)."""
        accepted = tuple((item.effect, item.location) for item in current.placed)
        if accepted not in self._known:
            self._known[accepted] = rank_next(self.problem, self._coarse, current)
        return self._known[accepted]


def rank_next(problem: Problem, coarse: Problem, current: Fitted) -> tuple[Ranked, ...]:
    """All effects at all places added to ``current``: screened by linearised fits, the promising ones refined.

    Args:
        problem: the problem.
        coarse: the same with every other sample, for screening.
        current: what is accepted already.
    """
    n = len(problem.nominal_rows)
    known = {(item.effect.name, item.location) for item in current.placed}
    screened = [s for s in screen(*linearised(coarse, current)) if (s.effect.name, s.location) not in known]
    places = dict(Counter(item.effect.name for item in screened))
    rough = [_refined(coarse, current, item) for item in _shortlist(screened)]
    top, before = min(rough, key=lambda f: f.power, default=None), judged_by(coarse, current)
    if top is not None and _worth(top, top.power / n) > _worth(before, top.power / n):
        rough += [_refined(coarse, current, item) for item in _neighbours(screened, rough, top)]
    open_after = (min(f.power for f in rough) if rough else current.power) / n
    if open_after > NOISE_SLACK or not problem.repeatability.repeatable:
        rough += _further(coarse, rough)
        gain = 0.5 * (before.power - min((f.power for f in rough), default=np.inf))
        rough += _contacts(problem, coarse, current, places, _WORTH_A_LOOK * gain)
    fits = _in_full(problem, rough, before)
    fits = [f for f in fits if current.power - f.power > f.placed[-1].effect.least_shrink * n]
    if not fits:
        return ()
    choices = [float(np.log(places.get(fit.placed[-1].effect.name, 1))) for fit in fits]
    return by_evidence(list(zip(fits, choices, strict=True)), current, problem)


def by_evidence(fits: list[tuple[Fitted, float]], current: Fitted, problem: Problem) -> tuple[Ranked, ...]:
    """Fits, each with what the number of its places costs, ranked by evidence over ``current``, best first."""
    over = _overdispersion(problem, min((fit for fit, _ in fits), key=lambda fit: fit.power))
    ranked = []
    for fit, choice in fits:
        gain = 0.5 * (current.power - fit.power) / over
        ranked.append(Ranked(fit, gain - (fit.price - current.price) - choice, choice))
    return tuple(sorted(ranked, key=lambda item: -item.evidence))


def _overdispersion(problem: Problem, fitted: Fitted) -> float:
    """Variance of what a fit leaves over that of noise, times that by which it is fewer numbers than noise is.

    What a wrong form leaves sits in a few frequencies: as many numbers as make its kurtosis that of a Gaussian
    speak for or against a hypothesis, and not all of them.
    """
    n = len(problem.nominal_rows)
    if fitted.power < NOISE_SLACK * n:
        return max(1.0, fitted.power / n)
    squares = problem.rows(explained_state(problem, fitted)) ** 2
    effective = 3.0 * squares.sum() ** 2 / (squares**2).sum()
    return float(fitted.power / min(n, effective))


def _in_full(problem: Problem, rough: list[Fitted], before: Fitted) -> list[Fitted]:
    """Fits to every other sample, those that may lead, and are worth their price, repeated on all of them."""
    if not rough:
        return []
    over = min(f.power for f in rough) / len(problem.nominal_rows)
    worth = [_worth(f, over) for f in rough]
    leading = max(max(worth) - _LEADING * DECISIVE, _worth(before, over))
    return [
        refine(problem, fit.placed, fit.theta, fit) if value > leading else judged_by(problem, fit)
        for value, fit in zip(worth, rough, strict=True)
    ]


def _worth(fit: Fitted, over: float) -> float:
    """What a fit explains less what it costs, but for a constant, where noise is ``over`` times as loud [nats]."""
    return -0.5 * fit.power / max(1.0, over) - fit.price


def _shortlist(screened: list[Screened]) -> list[Screened]:
    """The first few of all, and the best of each effect that explains a good part of what the first does."""
    chosen = [item for item in screened[:_FIRST_LOOK] if item.fit.evidence > 0.0]
    least = _WORTH_A_LOOK * max((item.fit.gain for item in chosen), default=0.0)
    for effect in FLOATING_EFFECTS.values():
        own = [s for s in screened if s.effect is effect and s.fit.evidence > 0.0 and s.fit.gain > least]
        chosen += [item for item in own[:_PER_EFFECT] if item not in chosen]
    return chosen


def _neighbours(screened: list[Screened], done: list[Fitted], top: Fitted) -> list[Screened]:
    """Other places of the leading effect that may turn out as good."""
    seen = {(f.placed[-1].effect.word, f.placed[-1].location) for f in done}
    word = top.placed[-1].effect.word
    own = [item for item in screened if item.effect.word == word]
    if not own:
        return []
    close = [item for item in own if item.fit.gain > 0.97 * own[0].fit.gain - 2.0 * DECISIVE]
    return [item for item in close if (word, item.location) not in seen][:_NEIGHBOURS]


def _refined(problem: Problem, current: Fitted, item: Screened) -> Fitted:
    placed, start = Placed(item.effect, item.location), item.start(problem.nominal)
    return refine(
        problem, (*current.placed, placed), (*current.theta, start), current, item.effect.rough_steps
    )


def _further(problem: Problem, rough: list[Fitted]) -> list[Fitted]:
    """Further forms of effects at the places where these explain most."""
    found = []
    for form, others in FURTHER_FORMS.items():
        own = [fit for fit in rough if fit.placed[-1].effect is FLOATING_EFFECTS[form]]
        for fit in sorted(own, key=lambda fit: fit.power)[:_FURTHER]:
            *before, last = fit.placed
            for other in others:
                placed = (*before, Placed(other, last.location))
                found.append(refine(problem, placed, fit.theta, fit, other.rough_steps))
    return found


def _contacts(
    problem: Problem, coarse: Problem, current: Fitted, places: dict[str, int], least: float
) -> list[Fitted]:
    """Links with an unlogged contact: its times or a surface paid for, whichever explains more.

    Surfaces that gain less than ``least`` by a linear fit [nats] are left out.
    """
    places[UnloggedContact.name] = len(links(problem.nominal))
    timed = _timed_contacts(problem, coarse, current)
    soft = [fit for fit in (pressed(coarse, contact) for contact in timed) if fit is not None]
    if min((f.power for f in timed + soft), default=np.inf) > NOISE_SLACK * len(problem.nominal_rows):
        soft += find_surfaces(coarse, current, least, FloatingEffect.rough_steps)
    return max(timed, soft, key=lambda fits: max((f.evidence for f in fits), default=-np.inf))


def _timed_contacts(problem: Problem, coarse: Problem, current: Fitted) -> list[Fitted]:
    """The best contact by its times, and its neighbours."""
    found = find_contact(problem, current)
    if found is None:
        return []
    effect: FloatingEffect = found.placed[-1].effect
    beside, state, rows = linearised(coarse, current)
    linear = {
        link: beside.fit(rows, effect_columns(coarse, state, effect, link, effect.beginnings(state, link)[0]))
        for link in effect.locations(problem.nominal)
    }
    nearest = sorted(linear, key=lambda link: -linear[link].evidence)[: _NEIGHBOURS // 2]
    return [
        refine(
            coarse,
            (*current.placed, Placed(effect, link)),
            (*current.theta, linear[link].theta * effect.scales(problem.nominal, link)),
            current,
            effect.rough_steps,
        )
        for link in nearest
    ]
