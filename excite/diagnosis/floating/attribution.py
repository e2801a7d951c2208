"""From hypotheses to a verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.floating.contact_times import PRICE_OF_A_SWITCH, find_contact
from excite.diagnosis.floating.effects.effect import FloatingEffect
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS
from excite.diagnosis.floating.held_out import held_out_gain
from excite.diagnosis.floating.problem import Problem, build_problem
from excite.diagnosis.floating.refinement import (
    Fitted,
    Placed,
    apply_all,
    explained_state,
    nominal_fit,
    refine,
)
from excite.diagnosis.floating.screening import Screened, effect_columns, screen
from excite.diagnosis.floating.spectrum import NOT_NOISE, repeat_levels
from excite.diagnosis.floating.state import State
from excite.diagnosis.result import Verdict

# Nats by which evidence must differ before one hypothesis is preferred (odds of 150 to 1).
DECISIVE = 5.0
# Evidence, after the number of places is paid for, that an effect must have to be there at all.
SIGNIFICANT = 8.0
# Power over the expected noise that repeated trials, which set it, leave open.
NOISE_SLACK = 1.5
# Share of the power above the noise that the accepted effects must explain.
EXPLAINED = 0.85
# A further effect must close this share of the power above the noise that is still open, and of all of it;
# more where one of its kind is accepted already, since that is what an approximate form leaves behind.
_FURTHER_SHARE, _FURTHER_OF_ALL, _SAME_OF_ALL = 0.3, 0.002, 0.1
_MOST_EFFECTS = 3
_FIRST_LOOK, _PER_EFFECT, _NEIGHBOURS = 6, 1, 14


@dataclass(frozen=True, eq=False)
class Ranked:
    """A refined hypothesis among its rivals.

    Attributes:
        fitted: the fit.
        evidence: log Bayes factor, for noise as large as the best hypothesis leaves, places paid for [nats].
    """

    fitted: Fitted
    evidence: float

    @property
    def last(self) -> Placed:
        """The effect that it adds."""
        return self.fitted.placed[-1]


@dataclass(frozen=True, eq=False)
class Attribution:
    """The verdict and what it rests on.

    Attributes:
        verdict: ``none``, ``effect``, ``ambiguous`` or ``unknown``.
        baseline: the baseline's fit.
        steps: for each accepted effect, all its rivals, best first.
        rivals: names that the data cannot tell from the first accepted effect, itself first.
        tied: places that the data cannot tell from each accepted effect's, itself first.
        overdispersion: power that the accepted effects leave over that expected.
        explained: share of the power above the noise that they explain.
    """

    verdict: Verdict
    baseline: Fitted
    steps: tuple[tuple[Ranked, ...], ...]
    rivals: tuple[Ranked, ...]
    tied: tuple[tuple[str, ...], ...]
    overdispersion: float
    explained: float

    @property
    def accepted(self) -> Fitted:
        """The fit with all accepted effects."""
        return self.steps[-1][0].fitted if self.steps else self.baseline


def attribute(problem: Problem) -> Attribution:
    """Add effects one by one until the noise is reached or nothing explains what is left."""
    coarse = build_problem(problem.record.thinned())
    baseline = nominal_fit(problem)
    n = len(problem.nominal_rows)
    current = baseline
    steps: list[tuple[Ranked, ...]] = []
    while len(steps) < _MOST_EFFECTS:
        ranked = rank_next(problem, coarse, current)
        if not ranked or not _worthwhile(ranked[0], current, baseline, n, first=not steps):
            break
        if not held_out_gain(problem, current, ranked[0].fitted) > 0.0:
            break
        steps.append(ranked)
        current = ranked[0].fitted
        if current.power < NOISE_SLACK * n:
            break
    over = max(1.0, current.power / n)
    open_power = baseline.power - n
    explained = 0.0 if open_power <= 0.0 else 1.0 - max(0.0, current.power - n) / open_power
    tied = tuple(_tied(step) for step in steps)
    rivals = _rivals(steps[0], n) if steps else ()
    verdict = _verdict(problem, baseline, steps, rivals, explained, n)
    return Attribution(verdict, baseline, tuple(steps), rivals, tied, over, explained)


def rank_next(problem: Problem, coarse: Problem, current: Fitted) -> tuple[Ranked, ...]:
    """All effects at all places added to ``current``: screened by linearised fits, the promising ones refined.

    Args:
        problem: the problem.
        coarse: the same with every other sample, for screening.
        current: what is accepted already.
    """
    n = len(problem.nominal_rows)
    state = explained_state(coarse, current)
    rows = coarse.rows(state) + coarse.baseline_rows(current.delta)
    screened = screen(coarse, state, rows)
    places = {name: max(1, sum(s.effect.name == name for s in screened)) for name in FLOATING_EFFECTS}
    fits = [_refined(problem, current, item) for item in _shortlist(screened)]
    top = min(fits, key=lambda f: f.power, default=None)
    if top is not None:
        fits += [_refined(problem, current, item) for item in _neighbours(screened, fits, top)]
    open_after = (min(f.power for f in fits) if fits else current.power) / n
    if open_after > NOISE_SLACK or not problem.repeatability.repeatable:
        fits += _contacts(problem, current, places)
    fits = [f for f in fits if current.power - f.power > f.placed[-1].effect.least_shrink * n]
    if not fits:
        return ()
    over = max(1.0, min(f.power for f in fits) / n)
    ranked = [
        Ranked(
            f, 0.5 * (current.power - f.power) / over - (f.price - current.price) - np.log(_places(f, places))
        )
        for f in fits
    ]
    return tuple(sorted(ranked, key=lambda item: -item.evidence))


def _places(fitted: Fitted, places: dict[str, int]) -> int:
    return places.get(fitted.placed[-1].effect.name, 1)


def _shortlist(screened: list[Screened]) -> list[Screened]:
    """The first few of all, and the best of each effect that explains anything."""
    chosen = [item for item in screened[:_FIRST_LOOK] if item.fit.evidence > 0.0]
    for name in FLOATING_EFFECTS:
        own = [item for item in screened if item.effect.name == name and item.fit.evidence > 0.0]
        chosen += [item for item in own[:_PER_EFFECT] if item not in chosen]
    return chosen


def _neighbours(screened: list[Screened], done: list[Fitted], top: Fitted) -> list[Screened]:
    """Other places of the leading effect that may turn out as good."""
    seen = {(f.placed[-1].effect.name, f.placed[-1].location) for f in done}
    name = top.placed[-1].effect.name
    own = [item for item in screened if item.effect.name == name]
    if not own:
        return []
    close = [item for item in own if item.fit.gain > 0.97 * own[0].fit.gain - 2.0 * DECISIVE]
    return [item for item in close if (name, item.location) not in seen][:_NEIGHBOURS]


def _refined(problem: Problem, current: Fitted, item: Screened) -> Fitted:
    start = item.fit.theta * item.effect.scales(problem.nominal, item.location)
    placed = Placed(item.effect, item.location)
    return refine(problem, (*current.placed, placed), (*current.theta, start), current)


def _contacts(problem: Problem, current: Fitted, places: dict[str, int]) -> list[Fitted]:
    """The best unlogged contact and its neighbours, the moments of change paid for."""
    found = find_contact(problem, current)
    if found is None:
        return []
    effect: FloatingEffect = found.fitted.placed[-1].effect
    state = apply_all(
        State.logged(problem.record, problem.record.tree.phi + found.fitted.delta),
        current.placed,
        current.theta,
    )
    rows = problem.rows(state) + problem.baseline_rows(found.fitted.delta)
    locations = effect.locations(problem.nominal)
    places[effect.name] = len(locations)
    linear = {
        link: problem.fit(rows, effect_columns(problem, state, effect, link, np.zeros(3))).evidence
        for link in locations
    }
    nearest = sorted(locations, key=lambda link: -linear[link])[: _NEIGHBOURS // 2]
    fits = [
        refine(problem, (*current.placed, Placed(effect, link)), found.fitted.theta, found.fitted)
        for link in nearest
    ]
    price = PRICE_OF_A_SWITCH * found.switches
    return [
        Fitted(f.placed, f.theta, f.std, f.delta, f.power, f.evidence - price, f.price + price) for f in fits
    ]


def _worthwhile(best: Ranked, current: Fitted, baseline: Fitted, n: int, *, first: bool) -> bool:
    if best.evidence < SIGNIFICANT:
        return False
    closed = current.power - best.fitted.power
    if first:
        return True
    known = {item.effect.name for item in current.placed}
    of_all = _SAME_OF_ALL if best.last.effect.name in known else _FURTHER_OF_ALL
    return closed > _FURTHER_SHARE * (current.power - n) and closed > of_all * (baseline.power - n)


def _tied(step: tuple[Ranked, ...]) -> tuple[str, ...]:
    best = step[0]
    return tuple(
        item.last.location
        for item in step
        if item.last.effect.name == best.last.effect.name and item.evidence > best.evidence - DECISIVE
    )


def _rivals(step: tuple[Ranked, ...], n: int) -> tuple[Ranked, ...]:
    chosen: dict[str, Ranked] = {}
    for item in step:
        if item.evidence > step[0].evidence - DECISIVE:
            chosen.setdefault(item.last.effect.name, item)
    return tuple(chosen.values())


def _verdict(
    problem: Problem,
    baseline: Fitted,
    steps: list[tuple[Ranked, ...]],
    rivals: tuple[Ranked, ...],
    explained: float,
    n: int,
) -> Verdict:
    quiet = baseline.power < NOISE_SLACK * n and problem.repeatability.repeatable
    if not steps:
        return "none" if quiet else "unknown"
    accepted = steps[-1][0].fitted
    if (accepted.power > NOISE_SLACK * n and explained < EXPLAINED) or not _repeats(problem, accepted):
        return "unknown"
    return "ambiguous" if len(rivals) > 1 else "effect"


def _repeats(problem: Problem, fitted: Fitted) -> bool:
    """Whether repeated trials differ by no more than noise once a fit's effects are taken out."""
    white = problem.whitening(explained_state(problem, fitted).residual)
    levels = repeat_levels(problem.whitening, white)
    return levels is None or float(levels[: len(levels) // 2].mean()) < NOT_NOISE
