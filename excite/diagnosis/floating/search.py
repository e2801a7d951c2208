"""The search for effects of robots with a free base."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import scipy

from excite.arrays import Array
from excite.diagnosis.floating.answer import held_out_gain
from excite.diagnosis.floating.effect import FloatingEffect, link_names, segment_of
from excite.diagnosis.floating.forces import PressedContact, Surface, UnloggedContact
from excite.diagnosis.floating.hypotheses import (
    Fitted,
    Placed,
    Screened,
    apply_all,
    effect_columns,
    explained_state,
    judged_by,
    linearise_fit,
    nominal_fit,
    refine_fit,
    screen_effects,
)
from excite.diagnosis.floating.problem import NOISE_SLACK, Problem, build_problem
from excite.diagnosis.floating.registry import FLOATING_EFFECTS, FURTHER_FORMS
from excite.diagnosis.floating.state import State
from excite.progress import step

# All effects at all places, as one more beside those that are accepted already.

# Nats by which evidence must differ before one hypothesis is preferred (odds of 150 to 1).
DECISIVE = 5.0
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
    def last_placed(self) -> Placed:
        """The effect that it adds."""
        return self.fitted.placed[-1]


class Ranker:
    """Ranks what may come next to effects that are accepted; for the same effects it is asked again and again.

    Attributes:
        problem: the problem.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self._coarse = build_problem(problem.record.halve_rate())
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
        coarse: the same with every other sample, for screening.
        current: what is accepted already.
    """
    n = len(problem.nominal_rows)
    known = {(item.effect.name, item.location) for item in current.placed}
    screened = [
        s for s in screen_effects(*linearise_fit(coarse, current)) if (s.effect.name, s.location) not in known
    ]
    places = dict(Counter(item.effect.name for item in screened))
    rough = [_refine_candidate(coarse, current, item) for item in _shortlist_effects(screened)]
    top, before = min(rough, key=lambda f: f.power, default=None), judged_by(coarse, current)
    if top is not None and _penalised_gain(top, top.power / n) > _penalised_gain(before, top.power / n):
        rough += [
            _refine_candidate(coarse, current, item) for item in _neighbouring_places(screened, rough, top)
        ]
    open_after = (min(f.power for f in rough) if rough else current.power) / n
    if open_after > NOISE_SLACK or not problem.repeatability.repeatable:
        rough += _refine_further_forms(coarse, rough)
        gain = 0.5 * (before.power - min((f.power for f in rough), default=np.inf))
        rough += _fit_contacts(problem, coarse, current, places, _WORTH_A_LOOK * gain)
    fits = _in_full(problem, rough, before)
    fits = [f for f in fits if current.power - f.power > f.placed[-1].effect.least_shrink * n]
    if not fits:
        return ()
    choices = [float(np.log(places.get(fit.placed[-1].effect.name, 1))) for fit in fits]
    return by_evidence(list(zip(fits, choices, strict=True)), current, problem)


def by_evidence(fits: list[tuple[Fitted, float]], current: Fitted, problem: Problem) -> tuple[Ranked, ...]:
    """Fits, each with what the number of its places costs, ranked by evidence over ``current``, best first."""
    over = _estimate_overdispersion(problem, min((fit for fit, _ in fits), key=lambda fit: fit.power))
    ranked = []
    for fit, choice in fits:
        gain = 0.5 * (current.power - fit.power) / over
        ranked.append(Ranked(fit, gain - (fit.price - current.price) - choice, choice))
    return tuple(sorted(ranked, key=lambda item: -item.evidence))


def _estimate_overdispersion(problem: Problem, fitted: Fitted) -> float:
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


def _in_full(problem: Problem, rough: list[Fitted], before: Fitted) -> list[Fitted]:
    """Fits to every other sample, those that may lead, and are worth their price, repeated on all of them."""
    if not rough:
        return []
    over = min(f.power for f in rough) / len(problem.nominal_rows)
    worth = [_penalised_gain(f, over) for f in rough]
    leading = max(max(worth) - _LEADING * DECISIVE, _penalised_gain(before, over))
    return [
        refine_fit(problem, fit.placed, fit.theta, fit) if value > leading else judged_by(problem, fit)
        for value, fit in zip(worth, rough, strict=True)
    ]


def _penalised_gain(fit: Fitted, over: float) -> float:
    """What a fit explains less what it costs, but for a constant, where noise is ``over`` times as loud [nats]."""
    return -0.5 * fit.power / max(1.0, over) - fit.price


def _shortlist_effects(screened: list[Screened]) -> list[Screened]:
    """The first few of all, and the best of each effect that explains a good part of what the first does."""
    chosen = [item for item in screened[:_FIRST_LOOK] if item.fit.evidence > 0.0]
    least = _WORTH_A_LOOK * max((item.fit.gain for item in chosen), default=0.0)
    for effect in FLOATING_EFFECTS.values():
        own = [s for s in screened if s.effect is effect and s.fit.evidence > 0.0 and s.fit.gain > least]
        chosen += [item for item in own[:_PER_EFFECT] if item not in chosen]
    return chosen


def _neighbouring_places(screened: list[Screened], done: list[Fitted], top: Fitted) -> list[Screened]:
    """Other places of the leading effect that may turn out as good."""
    seen = {(f.placed[-1].effect.form_name, f.placed[-1].location) for f in done}
    word = top.placed[-1].effect.form_name
    own = [item for item in screened if item.effect.form_name == word]
    if not own:
        return []
    close = [item for item in own if item.fit.gain > 0.97 * own[0].fit.gain - 2.0 * DECISIVE]
    return [item for item in close if (word, item.location) not in seen][:_NEIGHBOURS]


def _refine_candidate(problem: Problem, current: Fitted, item: Screened) -> Fitted:
    placed, start = Placed(item.effect, item.location), item.start_parameters(problem.nominal)
    return refine_fit(
        problem, (*current.placed, placed), (*current.theta, start), current, item.effect.rough_steps
    )


def _refine_further_forms(problem: Problem, rough: list[Fitted]) -> list[Fitted]:
    """Further forms of effects at the places where these explain most."""
    found = []
    for form, others in FURTHER_FORMS.items():
        own = [fit for fit in rough if fit.placed[-1].effect is FLOATING_EFFECTS[form]]
        for fit in sorted(own, key=lambda fit: fit.power)[:_FURTHER]:
            *before, last = fit.placed
            for other in others:
                placed = (*before, Placed(other, last.location))
                found.append(refine_fit(problem, placed, fit.theta, fit, other.rough_steps))
    return found


def _fit_contacts(
    problem: Problem, coarse: Problem, current: Fitted, places: dict[str, int], least: float
) -> list[Fitted]:
    """Links with an unlogged contact: its times or a surface paid for, whichever explains more.

    Surfaces that gain less than ``least`` by a linear fit [nats] are left out.
    """
    if not UnloggedContact().is_seen(problem.record):
        return []
    places[UnloggedContact.name] = len(link_names(problem.nominal))
    timed = _timed_contacts(problem, coarse, current)
    soft = [fit for fit in (fit_pressed_contact(coarse, contact) for contact in timed) if fit is not None]
    if min((f.power for f in timed + soft), default=np.inf) > NOISE_SLACK * len(problem.nominal_rows):
        soft += find_surfaces(coarse, current, least, FloatingEffect.rough_steps)
    return max(timed, soft, key=lambda fits: max((f.evidence for f in fits), default=-np.inf))


def _timed_contacts(problem: Problem, coarse: Problem, current: Fitted) -> list[Fitted]:
    """The best contact by its times, and its neighbours."""
    found = find_contact(problem, current)
    if found is None:
        return []
    effect: FloatingEffect = found.placed[-1].effect
    beside, state, rows = linearise_fit(coarse, current)
    linear = {
        link: beside.fit_columns(
            rows, effect_columns(coarse, state, effect, link, effect.fit_starts(state, link)[0])
        )
        for link in effect.locations(problem.nominal)
    }
    nearest = sorted(linear, key=lambda link: -linear[link].evidence)[: _NEIGHBOURS // 2]
    return [
        refine_fit(
            coarse,
            (*current.placed, Placed(effect, link)),
            (*current.theta, linear[link].theta * effect.parameter_scales(problem.nominal, link)),
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


def find_contact(problem: Problem, before: Fitted) -> Fitted | None:
    """Alternate between when and where, from two clusters of the smoothed residual; None if there are not two.

    Args:
        before: what is explained already.
    """
    residual = problem.record.smooth_signal(explained_state(problem, before).residual, _SMOOTH_HZ)
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
        found = _alternate_contact_fits(problem, before, _remove_short_spells(problem, raw))
        if found is not None and (best is None or found.evidence > best.evidence):
            best = found
        if best is not None and best.power < 2.0 * len(problem.nominal_rows):
            break
    return best


def _alternate_contact_fits(problem: Problem, before: Fitted, share: Array) -> Fitted | None:
    best: Fitted | None = None
    beside, state, rows = linearise_fit(problem, before)
    for _ in range(_ROUNDS):
        price = _PRICE_OF_A_SWITCH * float((np.abs(np.diff(share > 0.5))).sum())
        effect = UnloggedContact(share, share[problem.record.every_other], price)
        ranked = sorted(
            (
                (
                    beside.fit_columns(
                        rows, effect_columns(problem, state, effect, link, effect.fit_starts(state, link)[0])
                    ),
                    link,
                )
                for link in effect.locations(state)
            ),
            key=lambda item: -item[0].evidence,
        )[:2]
        fits = [
            refine_fit(
                problem,
                (*before.placed, Placed(effect, link)),
                (*before.theta, fit.theta * effect.parameter_scales(state, link)),
                before,
            )
            for fit, link in ranked
        ]
        found = max(fits, key=lambda item: item.evidence)
        if best is not None and found.evidence <= best.evidence + 1.0:
            return best
        best = found
        share = _remove_short_spells(problem, estimate_contact_share(problem, found))
        if not 0.01 < share.mean() < 0.99:
            return best
    return best


def estimate_contact_share(problem: Problem, fitted: Fitted) -> Array:
    """Share of the fitted force that acts at each instant, ``(n,)``, by weighted projection."""
    *_, place = fitted.placed
    *_, force = fitted.theta
    state = problem.state_with_errors(fitted.delta)
    state = apply_all(state, fitted.placed[:-1], fitted.theta[:-1])
    always = UnloggedContact(np.ones(problem.record.n_samples)).apply_to(state, place.location, force)
    pull = state.residual - always.residual
    weight = np.linalg.inv(problem.record.sensor_noise)
    residual = problem.record.smooth_signal(state.residual, 5.0)
    return np.einsum("ni,ij,nj->n", residual, weight, pull) / np.einsum("ni,ij,nj->n", pull, weight, pull)


def _remove_short_spells(problem: Problem, raw: Array) -> Array:
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


def _two_means(score: Array) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(score, [0.1, 0.9]))
    for _ in range(20):
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


def fit_pressed_contact(problem: Problem, contact: Fitted) -> Fitted | None:
    """A contact that was found in time, as one with a surface; None where no surface explains the times.

    Args:
        contact: a fit whose last effect is an unlogged contact.
    """
    place, theta = contact.placed[-1], contact.theta[-1]
    force = theta[:3]
    if not np.linalg.norm(force) > 0.0:
        return None
    state = explained_state(problem, contact)
    point = state.poses.point(segment_of(state, place.location) + 1, theta[3:6])
    normal = _surface_normal(force, -state.record.tree.gravity)
    found = _fit_surface(point @ normal, estimate_contact_share(problem, contact), normal)
    if found is None:
        return None
    surface, scale = found
    start = np.concatenate([scale * force, theta[3:6], np.zeros(4)])
    placed = (*contact.placed[:-1], Placed(PressedContact(surface), place.location))
    return refine_fit(problem, placed, (*contact.theta[:-1], start), contact)


def _surface_normal(force: Array, up: Array) -> Array:
    """Of a floor, a table or a ceiling where the force is mostly vertical, of a wall otherwise."""
    up = up / np.linalg.norm(up)
    lift = float(force @ up)
    level = force - lift * up
    return np.sign(lift) * up if abs(lift) > np.linalg.norm(level) else level / np.linalg.norm(level)


def _fit_surface(along: Array, share: Array, normal: Array) -> tuple[Surface, float] | None:
    """The surface that explains a measured share best by least squares, and its largest force over the fitted."""
    best, least = None, (1.0 - _LEAST_EXPLAINED) * float(((share - share.mean()) ** 2).sum())
    x, y, z = (float(part) for part in normal)
    for height in np.quantile(along, np.linspace(0.02, 1.0, _HEIGHTS)):
        for depth in _DEPTHS_M:
            for rounded in (False, True):
                surface = Surface((x, y, z), float(height), depth, rounded)
                model = surface.force_share(along)
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
        before: what is explained already.
        least: what a link's best must gain in the likelihood [nats] to be refined.
        steps: of the refinement.
    """
    beside, state, rows = linearise_fit(problem, before)
    factor = np.linalg.inv(np.linalg.cholesky(problem.record.sensor_noise))
    white = state.residual @ factor.T
    guesses, columns = [], []
    for link in link_names(state):
        point = state.poses.translation[:, segment_of(state, link) + 1]
        arms = state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point)
        best = _best_surface(state, point, factor @ arms, white)
        if best is None:
            continue
        effect = PressedContact(best)
        scales = effect.parameter_scales(state, link)
        guesses.append((link, effect, scales))
        # Linear in the force; where the point is and how the surface gives way come with the refinement.
        share = best.force_share(point @ np.array(best.normal))
        pushed = problem.whitening(-share[:, None, None] * arms) * scales[:3]
        columns.append(np.vstack([pushed, np.zeros((len(rows) - len(pushed), 3))]))
    fits = beside.fit_each(rows, columns) if columns else []
    likely = sorted(
        ((fit, guess) for fit, guess in zip(fits, guesses, strict=True) if fit.gain > least),
        key=lambda item: -item[0].evidence,
    )
    return [
        refine_fit(
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


# Which effects together: one by one, from several beginnings where one is not enough, and none that is not
# needed.

# Evidence, after the number of places is paid for, that an effect must have to be there at all.
SIGNIFICANT = 8.0
# The same for an effect within what the noise may be, after another that explains all above it.
_WITHIN_NOISE = 25.0
# A further effect must close this share of the power above the noise that is still open, and of all of it;
# more where one of its kind is accepted already, since that is what an approximate form leaves behind.
_FURTHER_SHARE, _FURTHER_OF_ALL, _SAME_OF_ALL = 0.3, 0.002, 0.1
# A further effect that closes this share of what is still open need not be large beside the others.
_CLOSES_ALL = 0.85
_MOST_EFFECTS = 3
# Effects from which a search for several begins, and what each must close at least of what the best closes.
_BEGINNINGS, _CLOSES = 2, 0.5
# Share of the open power below which what was found is not worth a second look.
_HOPEFUL = 0.7
# Where a form is seen to be wrong, others that leave this share more are as wrong as it is.
FORM_DOUBT = 0.1
# Share of the noise's power by which noise in the regressors' kinematics prefers one place to another.
_LITTLE_OF_NOISE = 0.1


@step("look for effects")
def search_effects(ranker: Ranker, baseline: Fitted) -> tuple[Step, ...]:
    """Effects that explain a record, each with its rivals, the accepted one first.

    Of two effects the first to be found may be one that imitates both a little. So where one effect leaves more
    than noise, each of the leading names is tried as the first, and the pair decides; then each meets its rivals
    again. Where it leaves no more than noise may be, a further one must be all the clearer.

    Args:
        ranker: of the problem.
        baseline: the baseline's fit.
    """
    problem = ranker.problem
    first = _next_step(ranker, baseline, baseline)
    if first is None:
        return ()
    chains: list[tuple[Step, ...]] = []
    for start in [first] if _is_noise_reached(problem, first[0].fitted) else _first_steps(first, baseline):
        second = _next_step(ranker, start[0].fitted, baseline)
        chains.append((start,) if second is None else (start, second))
    n = len(problem.nominal_rows)
    over = max(1.0, min(chain[-1][0].fitted.power for chain in chains) / n)
    chain = max(chains, key=lambda chain: _chain_evidence(chain, baseline, over))
    while len(chain) > 1 and chain[-1][0].fitted.power - n < (1.0 - _HOPEFUL) * (baseline.power - n):
        chain = _settle_chain(ranker, chain, baseline)
        if len(chain) == _MOST_EFFECTS or _is_noise_reached(problem, chain[-1][0].fitted):
            break
        further = _next_step(ranker, chain[-1][0].fitted, baseline)
        if further is None:
            break
        chain = (*chain, further)
    return chain


def _settle_chain(ranker: Ranker, chain: tuple[Step, ...], baseline: Fitted) -> tuple[Step, ...]:
    """The chain after exchanges, without what they have made superfluous."""
    while True:
        before = len(chain)
        chain = remove_superfluous(ranker.problem, exchange_effects(ranker, chain), baseline)
        if len(chain) == before:
            return chain


def _next_step(ranker: Ranker, current: Fitted, baseline: Fitted) -> Step | None:
    """The best further effect and its rivals; None if none is worth it."""
    problem, ranked = ranker.problem, ranker(current)
    if not ranked or not _is_worthwhile(ranked[0], current, baseline, len(problem.nominal_rows)):
        return None
    return ranked if held_out_gain(problem, current, ranked[0].fitted) > 0.0 else None


def _is_noise_reached(problem: Problem, fitted: Fitted) -> bool:
    return fitted.power < NOISE_SLACK * len(problem.nominal_rows)


def _is_worthwhile(best: Ranked, current: Fitted, baseline: Fitted, n: int) -> bool:
    if not current.placed:
        return best.evidence >= SIGNIFICANT
    closed = current.power - best.fitted.power
    known = any(_is_possible_remainder(item, best.last_placed) for item in current.placed)
    if current.power < NOISE_SLACK * n:
        return best.evidence >= _WITHIN_NOISE and not known
    if closed > _CLOSES_ALL * (current.power - n) and not known:
        # What is left by an approximate form is hardly ever all of another effect's.
        return best.evidence >= _WITHIN_NOISE
    of_all = _SAME_OF_ALL if known else _FURTHER_OF_ALL
    return (
        best.evidence >= SIGNIFICANT
        and closed > _FURTHER_SHARE * (current.power - n)
        and closed > of_all * (baseline.power - n)
    )


def _is_possible_remainder(found: Placed, further: Placed) -> bool:
    """Whether a further effect may be what an approximate form of one that was found leaves."""
    if found.effect.name == further.effect.name:
        return not found.effect.exact
    return found.location == further.location and further.effect.name in found.effect.leaves


def _first_steps(step: Step, baseline: Fitted) -> list[Step]:
    """The leading names, each with those rivals that it beats or that are of its kind."""
    least = _CLOSES * (baseline.power - min(item.fitted.power for item in step))
    begun: dict[str, Step] = {}
    for k, item in enumerate(step):
        name = item.last_placed.effect.name
        if name not in begun and baseline.power - item.fitted.power >= least:
            others = [r for r in step[:k] if r.last_placed.effect.name == name]
            begun[name] = (item, *others, *(r for r in step[k + 1 :]))
    return list(begun.values())[:_BEGINNINGS]


def _chain_evidence(chain: tuple[Step, ...], baseline: Fitted, over: float) -> float:
    last = chain[-1][0].fitted
    places = sum(step[0].choice for step in chain)
    return 0.5 * (baseline.power - last.power) / over - last.price - places


def remove_superfluous(problem: Problem, chain: tuple[Step, ...], baseline: Fitted) -> tuple[Step, ...]:
    """The chain without effects that those found after them have made superfluous."""
    n, k = len(problem.nominal_rows), 0
    while k < len(chain) - 1:
        full = chain[-1][0].fitted
        rest = [i for i in range(len(full.placed)) if i != k]
        placed, theta = tuple(full.placed[i] for i in rest), tuple(full.theta[i] for i in rest)
        without = refine_fit(problem, placed, theta, full)
        lost = 0.5 * (without.power - full.power) / max(1.0, full.power / n)
        lost -= full.price - without.price + chain[k][0].choice
        within = without.power < NOISE_SLACK * n
        little = without.power - full.power < _FURTHER_OF_ALL * (baseline.power - n) and not within
        if lost < (_WITHIN_NOISE if within else SIGNIFICANT) or little:
            last = (replace(chain[-1][0], fitted=without), *chain[-1][1:])
            chain = (*chain[:k], *chain[k + 1 : -1], last)
            k = 0
        else:
            k += 1
    return chain


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


# Exchange moves: each of several effects against all its rivals, with the others in place.

Step = tuple[Ranked, ...]

_TOGETHER_ROUNDS = 3


def exchange_effects(ranker: Ranker, chain: tuple[Step, ...]) -> tuple[Step, ...]:
    """The chain after every effect has met its rivals again.

    What was found first was found while the others still disturbed the fit: its name or place may be one that
    imitates a little of them all. So each in turn is taken out and sought again, until a round changes nothing
    (sequential replacement, Miller 2002).

    Args:
        ranker: of the problem.
        chain: effects in the order in which they were accepted.

    Returns:
        For each effect, in that order, its rivals given all the others, the accepted one first; the last step's
        first fit holds them all in that order.
    """
    for _ in range(_TOGETHER_ROUNDS):
        before = [_name_and_place(step[0]) for step in chain]
        for _ in before:
            chain = (*chain[1:], _sought_again(ranker, chain))
        if [_name_and_place(step[0]) for step in chain] == before:
            break
    return chain


def _sought_again(ranker: Ranker, chain: tuple[Step, ...]) -> Step:
    """Rivals of the first effect given the others, itself among them as the last."""
    problem = ranker.problem
    full, first = chain[-1][0].fitted, chain[0][0]
    placed, theta = (*full.placed[1:], full.placed[0]), (*full.theta[1:], full.theta[0])
    if len(placed) > 1:
        others = refine_fit(problem, placed[:-1], theta[:-1], full)
    else:
        others = nominal_fit(problem)
    present = Ranked(refine_fit(problem, placed, theta, full), 0.0, first.choice)
    found = ranker(others)
    same = [present, *(item for item in found if _name_and_place(item) == _name_and_place(present))]
    best = min(same, key=lambda item: 0.5 * item.fitted.power + item.fitted.price)
    rivals = [item for item in found if _name_and_place(item) != _name_and_place(present)]
    return by_evidence([(item.fitted, item.choice) for item in (best, *rivals)], others, problem)


def _name_and_place(item: Ranked) -> tuple[str, str]:
    return item.last_placed.effect.name, item.last_placed.location
