"""The search for effects of robots with a free base: selection among all effects at all places, shapes refined."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.answer import held_out_gain
from excite.diagnosis.floating.effect import FloatingEffect
from excite.diagnosis.floating.forces import find_contacts
from excite.diagnosis.floating.hypotheses import (
    Fitted,
    Placed,
    apply_all,
    effect_columns,
    explained_state,
    nominal_fit,
    refine_fit,
)
from excite.diagnosis.floating.problem import NOISE_SLACK, Problem
from excite.diagnosis.floating.registry import FLOATING_EFFECTS, FURTHER_FORMS
from excite.diagnosis.floating.state import State
from excite.diagnosis.selection import sampler
from excite.progress import step

T = TypeVar("T")

# Nats by which evidence must differ before one hypothesis is preferred (odds of 150 to 1).
DECISIVE = 5.0
# Evidence, after the number of places is paid for, that an effect must have to be there at all.
_SIGNIFICANT = 8.0
# Shares that any effect may take away of the noise's power, by noise in the regressors' kinematics, and of what the
# best fit leaves above it, where its form is wrong.
_TAKEN_OF_NOISE, _TAKEN_OF_REST = 0.1, 0.3
_TURNS, _SWEEPS, _BURNT = 6, 60, 20
# Hypotheses that are refined: the first few, the best of each form and other places of the first one.
_FIRST_LOOK, _NEIGHBOURS = 6, 14
# Share of the best linearised gain below which no iteration will bring a hypothesis to the top.
_WORTH_A_LOOK = 0.2
# An effect must close this share of all of the power above the noise; more beside another of its kind, since that is
# what an approximate form leaves behind.
_OF_ALL, _SAME_OF_ALL = 0.002, 0.1
# Share of the power above the noise that effects must explain to be named.
_EXPLAINED = 0.85
# Where a form is seen to be wrong, others that leave this share more are as wrong as it is.
FORM_DOUBT = 0.1
# Share of the noise's power by which noise in the regressors' kinematics prefers one place to another.
_LITTLE_OF_NOISE = 0.1


@dataclass(frozen=True, eq=False)
class Ranked:
    """A refined hypothesis among its rivals.

    Attributes:
        fitted: the fit, the effect in question the last of it.
        evidence: log Bayes factor, for noise as large as the best hypothesis leaves, places paid for [nats].
    """

    fitted: Fitted
    evidence: float

    @property
    def last_placed(self) -> Placed:
        """The effect that it adds."""
        return self.fitted.placed[-1]


Step = tuple[Ranked, ...]


@dataclass(frozen=True, eq=False)
class Atom:
    """An effect at a place, linearised, with the prior of its columns' sizes.

    Attributes:
        placed: the effect at its place.
        start: ``(k,)`` its parameters there.
        scales: ``(k,)`` of them.
        columns: ``(m, width)`` whitened: what it contributes at fitted parameters, then changes of the parameters.
        prior: of it and of their sizes.
    """

    placed: Placed
    start: Array
    scales: Array
    columns: Array
    prior: sampler.AtomPrior

    def parameters_at(self, sizes: Array) -> Array:
        """Parameters, in their units, at sizes ``(width,)`` of the columns."""
        return self.start + self.scales * sizes[-len(self.start) :]


@dataclass(frozen=True, eq=False)
class Selection:
    """Atoms beside each other as a selection problem.

    Attributes:
        atoms: group by group.
        problem: of them.
        state: ``(n_groups,)`` the atoms of the model that they are linearised at.
    """

    atoms: list[Atom]
    problem: sampler.Problem
    state: NDArray[np.int64]

    def fit_parameters(self, chosen: Sequence[int]) -> tuple[Array, ...]:
        """Parameters of some atoms beside each other."""
        own = [np.arange(self.problem.width[a]) + self.problem.first[a] for a in chosen]
        index = np.concatenate(own)
        normal = self.problem.gram[np.ix_(index, index)] + np.diag(self.problem.precision[index])
        sizes = np.split(
            np.linalg.solve(normal, self.problem.right[index]), np.cumsum([len(i) for i in own])[:-1]
        )
        return tuple(self.atoms[a].parameters_at(x) for a, x in zip(chosen, sizes, strict=True))


class Search:
    """The search in a record.

    Attributes:
        problem: of the record.
        shapes: by effect and place, parameters that were fitted.
        overdispersion: variance of what the best fit so far leaves over that of noise.
        least_power: that it leaves.
    """

    def __init__(self, problem: Problem, rng: np.random.Generator):
        self.problem, self._rng = problem, rng
        self.shapes: dict[tuple[FloatingEffect, str], Array] = {}
        self.overdispersion = self.least_power = np.inf
        self._ranked: dict[frozenset[tuple[FloatingEffect, str]], list[Fitted]] = {}
        self._absent: tuple[Fitted | None, dict[tuple[FloatingEffect, str], list[Atom]]] = (None, {})
        self._everywhere = [
            (effect, location)
            for effect in FLOATING_EFFECTS.values()
            if effect.name not in problem.record.modelled and effect.is_seen(problem.record)
            for location in effect.locations(problem.nominal)
        ]

    @step("look for effects")
    def run_search(self) -> Fitted:
        """The likeliest model, its shapes refined until no other is likelier or it explains too little."""
        current = nominal_fit(self.problem)
        self.rank_rivals(current)
        for _ in range(_TURNS):
            before, current = current, self._select_effects(current)
            if self._log_posterior(current) < self._log_posterior(before) + 1.0:
                return before
            if all(is_unexplained(self.problem, fit) for fit in (current, *self.rank_rivals(current))):
                break
            for k in range(len(current.placed)):
                self.rank_rivals(without_effect(self.problem, current, k))
        return current

    def _select_effects(self, current: Fitted) -> Fitted:
        """The likeliest of the models that the sampler meets, refined, without what it had for its columns' sake."""
        selection = self._linearise_effects(current)
        mode = sampler.find_mode(selection.problem, selection.state)
        draws = sampler.draw_models(selection.problem, mode, _SWEEPS, _BURNT, self._rng)
        chosen = [int(a) for a in draws.best if a >= 0]
        if not chosen:
            return nominal_fit(self.problem)
        placed = tuple(selection.atoms[a].placed for a in chosen)
        fitted = self._note_fit(refine_fit(self.problem, placed, selection.fit_parameters(chosen), current))
        return _drop_effects(
            self.problem,
            fitted,
            lambda fit, _, without: self._log_posterior(fit) > self._log_posterior(without),
        )

    def rank_rivals(self, others: Fitted) -> list[Fitted]:
        """Hypotheses of one effect more than ``others``, the likeliest by their columns, each refined."""
        known = _places_of(others)
        if known in self._ranked:
            return self._ranked[known]
        found = self._refine_likeliest(self._note_fit(others), [])
        n = len(self.problem.nominal_rows)
        best = min(found, key=lambda fit: fit.power, default=others)
        if best.power > NOISE_SLACK * n or not self.problem.repeatability.repeatable:
            forms = [
                (other, fit.placed[-1].location)
                for fit in found
                for other in FURTHER_FORMS.get(fit.placed[-1].effect.form_name, ())
            ]
            forms += find_contacts(self.problem, others)
            found += self._refine_likeliest(others, forms) if forms else []
        self._ranked[known] = found
        return found

    def _note_fit(self, fitted: Fitted) -> Fitted:
        """A fit by which noise is known to be no louder than what it leaves."""
        self.overdispersion = min(self.overdispersion, estimate_overdispersion(self.problem, fitted))
        self.least_power = min(self.least_power, fitted.power)
        return fitted

    def _refine_likeliest(
        self, others: Fitted, further: Sequence[tuple[FloatingEffect, str]]
    ) -> list[Fitted]:
        """The likeliest effects beside a fit, refined: of some further ones, or of all where there are none."""
        selection = self._linearise_effects(others, further)
        gains = sampler.gains_beside(selection.problem, selection.state)
        found = []
        for a in _choose_likeliest(selection, gains, {effect for effect, _ in further}):
            placed = selection.atoms[a].placed
            theta = (*others.theta, *selection.fit_parameters([a]))
            fit = refine_fit(self.problem, (*others.placed, placed), theta, others)
            found.append(self._note_fit(fit))
            self.shapes[placed.effect, placed.location] = fit.theta[-1]
        return found

    def _linearise_effects(
        self, current: Fitted, further: Sequence[tuple[FloatingEffect, str]] = ()
    ) -> Selection:
        """All effects at all places beside a model, and those of the model at their parameters."""
        problem, state = self.problem, explained_state(self.problem, current)
        here = problem.residual_rows(state)
        rows, base = here + problem.baseline_rows(current.delta), problem.state_with_errors(current.delta)
        groups: dict[tuple[str, str], list[Atom]] = {}
        for k, item in enumerate(current.placed):
            placed, theta = _leave_out(current.placed, k), _leave_out(current.theta, k)
            others = apply_all(base, placed, theta)
            atom = self._fitted_atom(others, problem.residual_rows(others), item, current.theta[k])
            rows = rows + atom.columns[:, 0]
            groups[_place_of(item)] = [atom]
        members = set(groups)
        if self._absent[0] is not current:
            self._absent = current, {}
        absent = self._absent[1]
        places = dict.fromkeys((*_places_of(current), *self._everywhere, *further, *self.shapes))
        for place in places:
            item = Placed(*place)
            if _place_of(item) in members:
                continue
            own = groups.setdefault(_place_of(item), [])
            if place in self.shapes:
                own.append(self._fitted_atom(state, here, item, self.shapes[place]))
                continue
            if place not in absent:
                starts = item.effect.fit_starts(state, item.location)
                absent[place] = [self._plain_atom(state, item, start) for start in starts]
            own += absent[place]
        odds = {effect: self._log_odds(effect) - effect.price for effect, _ in places}
        atoms = [atom for own in groups.values() for atom in own]
        priors = [atom.prior._replace(log_prior=odds[atom.placed.effect]) for atom in atoms]
        group = np.repeat(np.arange(len(groups)), [len(own) for own in groups.values()])
        columns = np.hstack([atom.columns for atom in atoms])
        shadow = problem.project_rows(columns)
        gram = (columns.T @ columns - shadow.T @ shadow) / self.overdispersion
        right = (columns.T @ rows - shadow.T @ problem.project_rows(rows)) / self.overdispersion
        none = np.full(len(groups), -1, dtype=np.int64)
        model = none.copy()
        model[: len(members)] = np.arange(len(members))
        return Selection(atoms, sampler.Problem.of_atoms(priors, group, none, gram, right), model)

    def _plain_atom(self, state: State, placed: Placed, start: Array) -> Atom:
        """An effect from where it is absent."""
        effect, location = placed.effect, placed.location
        columns = effect_columns(self.problem, state, effect, location, start)
        scales = effect.parameter_scales(self.problem.nominal, location)
        low = np.array([p.low for p in effect.parameters_at(state, location)])
        mean, free = np.zeros(len(start)), np.full(len(start), np.inf)
        return Atom(placed, start, scales, columns, sampler.AtomPrior(mean, mean + 1.0, low, free))

    def _fitted_atom(self, state: State, rows: Array, placed: Placed, theta: Array) -> Atom:
        """An effect about fitted parameters, beside a state that lacks it and its whitened residual ``(m,)``."""
        effect, location = placed.effect, placed.location
        there = self.problem.residual_rows(effect.apply_to(state, location, theta))
        changes = effect_columns(self.problem, state, effect, location, theta)
        scales = effect.parameter_scales(self.problem.nominal, location)
        mean, free = np.concatenate([[1.0], -theta / scales]), np.full(len(theta) + 1, np.inf)
        precision = np.concatenate([[sampler.FITTED_SIZE**-2], np.ones(len(theta))])
        columns = np.column_stack([rows - there, changes])
        return Atom(placed, theta, scales, columns, sampler.AtomPrior(mean, precision, -free, free))

    def _log_odds(self, effect: FloatingEffect) -> float:
        n = len(self.problem.nominal_rows)
        taken = _TAKEN_OF_NOISE * n + _TAKEN_OF_REST * max(0.0, self.least_power - n)
        return -_SIGNIFICANT - 0.5 * taken / self.overdispersion - choice_price(self.problem, effect)

    def _log_posterior(self, fitted: Fitted) -> float:
        """Of a model, but for a constant [nats]."""
        odds = sum(self._log_odds(item.effect) for item in fitted.placed)
        return odds - 0.5 * fitted.power / self.overdispersion - fitted.price

    def step_of(self, fitted: Fitted, k: int) -> Step:
        """An effect of a fit and its rivals beside the others, best evidence first."""
        own = _in_order(fitted, [*range(k), *range(k + 1, len(fitted.placed)), k])
        return self.step_beside(without_effect(self.problem, fitted, k), own)

    def step_beside(self, others: Fitted, known: Fitted | None = None) -> Step:
        """Hypotheses of one effect more than ``others``, best evidence first, with one that is known."""
        n = len(self.problem.nominal_rows)
        own = None if known is None else _place_of(known.placed[-1])
        fits = [
            fit
            for fit in self.rank_rivals(others)
            if _place_of(fit.placed[-1]) != own
            and others.power - fit.power > fit.placed[-1].effect.least_shrink * n
        ]
        fits += [] if known is None else [known]
        if not fits:
            return ()
        over = estimate_overdispersion(self.problem, min(fits, key=lambda fit: fit.power))
        ranked = (Ranked(fit, evidence_of(self.problem, others, fit, over)) for fit in fits)
        return tuple(sorted(ranked, key=lambda item: -item.evidence))


def search_effects(problem: Problem, baseline: Fitted) -> tuple[Step, ...]:
    """Effects that explain a record, largest first, each with its rivals beside the others, the accepted one first.

    The last step's first fit holds them all, in that order.
    """
    search = Search(problem, np.random.default_rng(0))
    fitted = search.run_search()
    if is_unexplained(problem, fitted):
        # As many patches as one likes explain a part of anything: the likeliest of single effects is listed.
        first = search.step_beside(baseline)
        return (first,) if first and _is_needed(problem, first[0].fitted, 0, baseline, baseline) else ()
    fitted = keep_needed(problem, fitted, baseline)
    steps: list[Step] = []
    for _ in fitted.placed:
        # Each in turn becomes the last.
        steps.append(search.step_of(fitted, 0))
        fitted = steps[-1][0].fitted
    return tuple(steps)


def is_unexplained(problem: Problem, fitted: Fitted) -> bool:
    """Whether a fit leaves more than noise, and a good part of the gap."""
    loud = fitted.power > NOISE_SLACK * len(problem.nominal_rows)
    return loud and explained_share(problem, fitted) < _EXPLAINED


def explained_share(problem: Problem, fitted: Fitted) -> float:
    """Share of the power above the noise that a fit explains; 0 where nothing stands above it."""
    n, before = len(problem.nominal_rows), nominal_fit(problem).power
    return 0.0 if before <= n else 1.0 - max(0.0, fitted.power - n) / (before - n)


def _choose_likeliest(selection: Selection, gains: Array, among: Set[FloatingEffect]) -> list[int]:
    """The first few of all, the best of each form that may still come to the top, and other places of the first.

    Args:
        among: effects to choose from; all where there are none.
    """
    evidence = gains - selection.problem.log_prior
    best: dict[tuple[FloatingEffect, str], int] = {}
    for a in np.argsort(-evidence):
        placed = selection.atoms[a].placed
        if evidence[a] > 0.0 and (not among or placed.effect in among):
            best.setdefault((placed.effect, placed.location), int(a))
    chosen: list[int] = []
    forms: Counter[str] = Counter()
    for (effect, _), a in best.items():
        form, top = effect.form_name, evidence[next(iter(best.values()))]
        leads = form in forms and form == next(iter(forms))
        near = leads and evidence[a] > 0.97 * top - 2.0 * DECISIVE and forms[form] < _NEIGHBOURS
        if len(chosen) < _FIRST_LOOK or near or (not forms[form] and evidence[a] > _WORTH_A_LOOK * top):
            chosen.append(a)
        forms[form] += 1
    return chosen


def keep_needed(problem: Problem, fitted: Fitted, baseline: Fitted) -> Fitted:
    """A fit without effects that the others make superfluous; largest first."""
    return _drop_effects(
        problem, fitted, lambda fit, k, without: _is_needed(problem, fit, k, without, baseline)
    )


def _drop_effects(
    problem: Problem, fitted: Fitted, is_needed: Callable[[Fitted, int, Fitted], bool]
) -> Fitted:
    """A fit without effects that it does not need, the weakest leaving first; largest first."""
    while fitted.placed:
        rest = [without_effect(problem, fitted, k) for k in range(len(fitted.placed))]
        order = sorted(range(len(rest)), key=lambda k: rest[k].power)
        gone = next((rest[k] for k in order if not is_needed(fitted, k, rest[k])), None)
        if gone is None:
            return _in_order(fitted, order[::-1])
        fitted = gone
    return fitted


def _is_needed(problem: Problem, fitted: Fitted, k: int, without: Fitted, baseline: Fitted) -> bool:
    """Whether an effect of a fit closes what the others do not, and the trial that checks agrees."""
    own, n = fitted.placed[k], len(problem.nominal_rows)
    closed = without.power - fitted.power
    nats = 0.5 * closed / estimate_overdispersion(problem, fitted) - (fitted.price - without.price)
    nats -= choice_price(problem, own.effect)
    known = any(_is_possible_remainder(item, own) for item in without.placed)
    of_all = (_SAME_OF_ALL if known else _OF_ALL) * (baseline.power - n)
    return (
        nats >= _SIGNIFICANT
        and closed > max(own.effect.least_shrink * n, of_all)
        and held_out_gain(problem, without, fitted) > 0.0
    )


def _is_possible_remainder(found: Placed, further: Placed) -> bool:
    """Whether a further effect may be what an approximate form of one that was found leaves."""
    if found.effect.name == further.effect.name:
        return not found.effect.exact
    return found.location == further.location and further.effect.name in found.effect.leaves


def tied_places(step: Step, n: int) -> tuple[str, ...]:
    """Places that the data cannot tell from the accepted effect's, itself first.

    Args:
        step: an effect's rivals, best first.
        n: number of whitened numbers.
    """
    best = step[0]
    same = (item for item in step if item.last_placed.effect.name == best.last_placed.effect.name)
    doubt = best.fitted.power + _LITTLE_OF_NOISE * n
    return tuple(
        dict.fromkeys(i.last_placed.location for i in same if _is_tied(i, best, n) or i.fitted.power < doubt)
    )


def find_tied_rivals(step: Step, n: int) -> tuple[Ranked, ...]:
    """The accepted effect and those of other names that the data cannot tell from it; arguments as above."""
    chosen: dict[str, Ranked] = {}
    for item in step:
        if _is_tied(item, step[0], n):
            chosen.setdefault(item.last_placed.effect.name, item)
    return tuple(chosen.values())


def _is_tied(item: Ranked, best: Ranked, n: int) -> bool:
    """Whether evidence does not decide between two, or what the form of the better one leaves is larger."""
    left = best.fitted.power - n
    misfit = FORM_DOUBT * left if best.fitted.power > NOISE_SLACK * n else 0.0
    return item.evidence > best.evidence - DECISIVE or item.fitted.power - best.fitted.power < misfit


def _in_order(fitted: Fitted, order: Sequence[int]) -> Fitted:
    return replace(
        fitted,
        placed=tuple(fitted.placed[i] for i in order),
        theta=tuple(fitted.theta[i] for i in order),
        std=tuple(fitted.std[i] for i in order),
    )


def _place_of(item: Placed) -> tuple[str, str]:
    return item.effect.name, item.location


def _places_of(fitted: Fitted) -> frozenset[tuple[FloatingEffect, str]]:
    return frozenset((item.effect, item.location) for item in fitted.placed)


def _leave_out(parts: tuple[T, ...], k: int) -> tuple[T, ...]:
    return parts[:k] + parts[k + 1 :]


def without_effect(problem: Problem, fitted: Fitted, k: int) -> Fitted:
    """A fit without one of its effects, the others refined."""
    placed, theta = _leave_out(fitted.placed, k), _leave_out(fitted.theta, k)
    return refine_fit(problem, placed, theta, fitted) if placed else nominal_fit(problem)


def estimate_overdispersion(problem: Problem, fitted: Fitted) -> float:
    """Variance of what a fit leaves over that of noise, times that by which it is fewer numbers than noise is.

    What a wrong form leaves sits in a few frequencies: as many numbers as make its kurtosis that of a Gaussian
    speak for or against a hypothesis, and not all of them.
    """
    n = len(problem.nominal_rows)
    if fitted.power < NOISE_SLACK * n:
        return max(1.0, fitted.power / n)
    squares = problem.residual_rows(explained_state(problem, fitted)) ** 2
    effective = 3.0 * squares.sum() ** 2 / (squares**2).sum()
    return float(fitted.power / min(n, effective))


def evidence_of(problem: Problem, others: Fitted, fitted: Fitted, over: float) -> float:
    """Evidence for a fit's last effect, where noise is ``over`` times as loud, its places paid for [nats]."""
    nats = 0.5 * (others.power - fitted.power) / over - (fitted.price - others.price)
    return nats - choice_price(problem, fitted.placed[-1].effect)


def choice_price(problem: Problem, effect: FloatingEffect) -> float:
    """What the number of an effect's places costs [nats]."""
    return float(np.log(max(1, len(effect.locations(problem.nominal)))))
