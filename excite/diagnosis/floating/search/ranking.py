"""All effects at all places, as one more beside those that are accepted already."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import scipy

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, links, segment_of
from excite.diagnosis.floating.effects.forces import PressedContact, Surface, UnloggedContact
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS, FURTHER_FORMS
from excite.diagnosis.floating.equations.problem import Problem, build_problem
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import (
    Fitted,
    Placed,
    Screened,
    apply_all,
    effect_columns,
    explained_state,
    judged_by,
    linearised,
    refine,
    screen,
)
from excite.logs.signals.butterworth import lowpass

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
    if not UnloggedContact().is_seen(problem.record):
        return []
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


# When was there a contact: two levels in what the baseline leaves.

_SMOOTH_HZ = 3.0
_SHORTEST_S = 0.25
_ROUNDS = 4
# Share of the variance that two levels must explain: 0.64 for Gaussian noise, 0.75 for an even spread.
_TWO_LEVELS = 0.8
# Each change between contact and none is a free moment in time.
_PRICE_OF_A_SWITCH = 6.0


def find_contact(problem: Problem, before: Fitted, shortlist: int = 2) -> Fitted | None:
    """Alternate between when and where, from two clusters of the smoothed residual; None if there are not two.

    Args:
        problem: the problem.
        before: what is explained already.
        shortlist: places refined a round.
    """
    residual = _smooth(problem, _leftover(problem, before))
    noise = np.sqrt(np.diag(problem.record.sensor_noise))
    centred = (residual - residual.mean(axis=0)) / noise
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    score = centred @ direction
    low, high = _two_means(score)
    upper = score > 0.5 * (low + high)
    between = upper.mean() * (1.0 - upper.mean()) * (high - low) ** 2
    if between < _TWO_LEVELS * score.var():
        return None
    best: Fitted | None = None
    for raw in ((score - low) / (high - low), (high - score) / (high - low)):
        found = _alternate(problem, before, _tidy(problem, raw), shortlist)
        if found is not None and (best is None or found.evidence > best.evidence):
            best = found
        if best is not None and best.power < 2.0 * len(problem.nominal_rows):
            break
    return best


def _alternate(problem: Problem, before: Fitted, share: Array, shortlist: int) -> Fitted | None:
    best: Fitted | None = None
    beside, state, rows = linearised(problem, before)
    for _ in range(_ROUNDS):
        price = _PRICE_OF_A_SWITCH * float((np.abs(np.diff(share > 0.5))).sum())
        effect = UnloggedContact(share, share[problem.record.every_other], price)
        ranked = sorted(
            (
                (
                    beside.fit(
                        rows, effect_columns(problem, state, effect, link, effect.beginnings(state, link)[0])
                    ),
                    link,
                )
                for link in effect.locations(state)
            ),
            key=lambda item: -item[0].evidence,
        )[:shortlist]
        fits = [
            refine(
                problem,
                (*before.placed, Placed(effect, link)),
                (*before.theta, fit.theta * effect.scales(state, link)),
                before,
            )
            for fit, link in ranked
        ]
        found = max(fits, key=lambda item: item.evidence)
        if best is not None and found.evidence <= best.evidence + 1.0:
            return best
        best = found
        share = _tidy(problem, pulled(problem, found))
        if not 0.01 < share.mean() < 0.99:
            return best
    return best


def _leftover(problem: Problem, fitted: Fitted) -> Array:
    return explained_state(problem, fitted).residual


def pulled(problem: Problem, fitted: Fitted) -> Array:
    """Share of the fitted force that acts at each instant, ``(n,)``, by weighted projection."""
    *_, place = fitted.placed
    *_, force = fitted.theta
    state = problem.state(fitted.delta)
    state = apply_all(state, fitted.placed[:-1], fitted.theta[:-1])
    always = UnloggedContact(np.ones(problem.record.n_samples)).apply(state, place.location, force)
    pull = state.residual - always.residual
    weight = np.linalg.inv(problem.record.sensor_noise)
    residual = np.concatenate(
        [lowpass(state.residual[s], problem.record.rate_hz, 5.0) for s in problem.record.spans]
    )
    return np.einsum("ni,ij,nj->n", residual, weight, pull) / np.einsum("ni,ij,nj->n", pull, weight, pull)


def _tidy(problem: Problem, raw: Array) -> Array:
    """On and off with the shortest spells removed; near a change, the measured share itself."""
    width = 2 * max(1, round(0.5 * _SHORTEST_S * problem.record.rate_hz)) + 1
    share = np.empty_like(raw)
    for span in problem.record.spans:
        on = scipy.ndimage.median_filter((raw[span] > 0.5).astype(float), width, mode="nearest")
        change = np.flatnonzero(np.diff(on))
        share[span] = on
        for index in change:
            near = slice(max(0, index - 2), min(len(on), index + 4))
            share[span][near] = np.clip(raw[span][near], 0.0, 1.0)
    return share


def _smooth(problem: Problem, values: Array) -> Array:
    rate = problem.record.rate_hz
    return np.concatenate([lowpass(values[span], rate, _SMOOTH_HZ) for span in problem.record.spans])


def _two_means(score: Array, rounds: int = 20) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(score, [0.1, 0.9]))
    for _ in range(rounds):
        upper = score > 0.5 * (low + high)
        if upper.all() or not upper.any():
            break
        low, high = float(score[~upper].mean()), float(score[upper].mean())
    return low, high


# Surfaces that a link may have been pressed on.

# Less of the share's variance than this is explained by nothing that stands still.
_LEAST_EXPLAINED = 0.5
_HEIGHTS, _DEPTHS_M = 25, (0.005, 0.01, 0.02, 0.035, 0.06, 0.1, 0.17, 0.3)
# Links that are fitted in full.
_LINKS = 6


def pressed(problem: Problem, contact: Fitted) -> Fitted | None:
    """A contact that was found in time, as one with a surface; None where no surface explains the times.

    Args:
        problem: the problem.
        contact: a fit whose last effect is an unlogged contact.
    """
    place, theta = contact.placed[-1], contact.theta[-1]
    force = theta[:3]
    if not np.linalg.norm(force) > 0.0:
        return None
    state = explained_state(problem, contact)
    point = state.poses.point(segment_of(state, place.location) + 1, theta[3:6])
    normal = _normal(force, -state.record.tree.gravity)
    found = _surface(point @ normal, pulled(problem, contact), normal)
    if found is None:
        return None
    surface, scale = found
    start = np.concatenate([scale * force, theta[3:6], np.zeros(4)])
    placed = (*contact.placed[:-1], Placed(PressedContact(surface), place.location))
    return refine(problem, placed, (*contact.theta[:-1], start), contact)


def _normal(force: Array, up: Array) -> Array:
    """Of a floor, a table or a ceiling where the force is mostly vertical, of a wall otherwise."""
    up = up / np.linalg.norm(up)
    lift = float(force @ up)
    level = force - lift * up
    return np.sign(lift) * up if abs(lift) > np.linalg.norm(level) else level / np.linalg.norm(level)


def _surface(along: Array, share: Array, normal: Array) -> tuple[Surface, float] | None:
    """The surface that explains a measured share best by least squares, and its largest force over the fitted."""
    best, least = None, (1.0 - _LEAST_EXPLAINED) * float(((share - share.mean()) ** 2).sum())
    x, y, z = (float(part) for part in normal)
    for height in np.quantile(along, np.linspace(0.02, 1.0, _HEIGHTS)):
        for depth in _DEPTHS_M:
            for rounded in (False, True):
                surface = Surface((x, y, z), float(height), depth, rounded)
                model = surface.share(along)
                power = float(model @ model)
                if power < 1e-9:
                    continue
                scale = float(model @ share) / power
                left = float(((share - scale * model) ** 2).sum())
                if scale > 0.0 and left < least:
                    best, least = (surface, scale), left
    return best


def find_surfaces(problem: Problem, before: Fitted, least: float, steps: int) -> list[Fitted]:
    """Contacts with something that gives way, sought by where each link was and not by when: the likeliest links.

    For each link and each surface that it passed, the force that explains most of what is left, instant by
    instant; then the links' best in the likelihood, and the best of those refined.

    Args:
        problem: the problem.
        before: what is explained already.
        least: what a link's best must gain in the likelihood [nats] to be refined.
        steps: of the refinement.
    """
    beside, state, rows = linearised(problem, before)
    factor = np.linalg.inv(np.linalg.cholesky(problem.record.sensor_noise))
    white = state.residual @ factor.T
    guesses, columns = [], []
    for link in links(state):
        point = state.poses.translation[:, segment_of(state, link) + 1]
        arms = state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point)
        best = _best_surface(state, point, factor @ arms, white)
        if best is None:
            continue
        effect = PressedContact(best)
        scales = effect.scales(state, link)
        guesses.append((link, effect, scales))
        # Linear in the force; where the point is and how the surface gives way come with the refinement.
        share = best.share(point @ np.array(best.normal))
        pushed = problem.whitening(-share[:, None, None] * arms) * scales[:3]
        columns.append(np.vstack([pushed, np.zeros((len(rows) - len(pushed), 3))]))
    fits = beside.fit_each(rows, columns) if columns else []
    likely = sorted(
        ((fit, guess) for fit, guess in zip(fits, guesses, strict=True) if fit.gain > least),
        key=lambda item: -item[0].evidence,
    )
    return [
        refine(
            problem,
            (*before.placed, Placed(effect, link)),
            (*before.theta, np.concatenate([fit.theta * scales[:3], np.zeros(7)])),
            before,
            steps,
        )
        for fit, (link, effect, scales) in likely[:_LINKS]
    ]


def _best_surface(state: State, point: Array, arms: Array, white: Array) -> Surface | None:
    """The surface that explains most of whitened residuals by one force whose share it is.

    Args:
        state: the state.
        point: ``(n, 3)`` that it meets, world [m].
        arms: ``(n, 6, 3)`` whitened wrench of a unit force there along each axis.
        white: ``(n, 6)`` whitened residual.
    """
    turned = arms.transpose(0, 2, 1)
    own, shared = (turned @ arms).reshape(-1, 9), -(turned @ white[:, :, None])[:, :, 0]
    best, most = None, 0.0
    up = -state.record.tree.gravity / np.linalg.norm(state.record.tree.gravity)
    for normal in (up, *np.eye(3)[:2], *-np.eye(3)[:2]):
        along = point @ normal
        x, y, z = (float(part) for part in normal)
        heights, depths = (
            part.ravel()
            for part in np.meshgrid(np.quantile(along, np.linspace(0.1, 1.0, _HEIGHTS // 2)), _DEPTHS_M[1::2])
        )
        shares = np.clip((heights[:, None] - along) / depths[:, None], 0.0, 1.0)
        grams, rights = (shares**2 @ own).reshape(-1, 3, 3), shares @ shared
        forces = np.linalg.solve(grams + 1e-9 * np.eye(3), rights[:, :, None])[:, :, 0]
        gains = np.where(forces @ normal > 0.0, (forces * rights).sum(axis=1), 0.0)
        k = int(gains.argmax())
        if gains[k] > most:
            best, most = Surface((x, y, z), float(heights[k]), float(depths[k]), False), float(gains[k])
    return best
