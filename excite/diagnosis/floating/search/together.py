"""Which effects together: one by one, from several beginnings where one is not enough, and none that is not needed."""

from __future__ import annotations

from dataclasses import replace

from excite.diagnosis.floating.answer import held_out_gain
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.ranking import DECISIVE, NOISE_SLACK, Ranked, Ranker, by_evidence
from excite.diagnosis.floating.search.refinement import Fitted, Placed, nominal_fit, refine
from excite.progress import step

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
def search(ranker: Ranker, baseline: Fitted) -> tuple[Step, ...]:
    """Effects that explain a record, each with its rivals, the accepted one first.

    Of two effects the first to be found may be one that imitates both a little. So where one effect leaves more
    than noise, each of the leading names is tried as the first, and the pair decides; then each meets its rivals
    again. Where it leaves no more than noise may be, a further one must be all the clearer.

    Args:
        ranker: of the problem.
        baseline: the baseline's fit.
    """
    problem = ranker.problem
    first = _step(ranker, baseline, baseline)
    if first is None:
        return ()
    chains: list[tuple[Step, ...]] = []
    for start in [first] if _enough(problem, first[0].fitted) else _beginnings(first, baseline):
        second = _step(ranker, start[0].fitted, baseline)
        chains.append((start,) if second is None else (start, second))
    n = len(problem.nominal_rows)
    over = max(1.0, min(chain[-1][0].fitted.power for chain in chains) / n)
    chain = max(chains, key=lambda chain: _evidence(chain, baseline, over))
    while len(chain) > 1 and chain[-1][0].fitted.power - n < (1.0 - _HOPEFUL) * (baseline.power - n):
        chain = _settled(ranker, chain, baseline)
        if len(chain) == _MOST_EFFECTS or _enough(problem, chain[-1][0].fitted):
            break
        further = _step(ranker, chain[-1][0].fitted, baseline)
        if further is None:
            break
        chain = (*chain, further)
    return chain


def _settled(ranker: Ranker, chain: tuple[Step, ...], baseline: Fitted) -> tuple[Step, ...]:
    """The chain after exchanges, without what they have made superfluous."""
    while True:
        before = len(chain)
        chain = needed(ranker.problem, exchanged(ranker, chain), baseline)
        if len(chain) == before:
            return chain


def _step(ranker: Ranker, current: Fitted, baseline: Fitted) -> Step | None:
    """The best further effect and its rivals; None if none is worth it."""
    problem, ranked = ranker.problem, ranker(current)
    if not ranked or not _worthwhile(ranked[0], current, baseline, len(problem.nominal_rows)):
        return None
    return ranked if held_out_gain(problem, current, ranked[0].fitted) > 0.0 else None


def _enough(problem: Problem, fitted: Fitted) -> bool:
    return fitted.power < NOISE_SLACK * len(problem.nominal_rows)


def _worthwhile(best: Ranked, current: Fitted, baseline: Fitted, n: int) -> bool:
    if not current.placed:
        return best.evidence >= SIGNIFICANT
    closed = current.power - best.fitted.power
    known = any(_alike(item, best.last) for item in current.placed)
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


def _alike(found: Placed, further: Placed) -> bool:
    """Whether a further effect may be what an approximate form of one that was found leaves."""
    if found.effect.name == further.effect.name:
        return not found.effect.exact
    return found.location == further.location and further.effect.name in found.effect.leaves


def _beginnings(step: Step, baseline: Fitted) -> list[Step]:
    """The leading names, each with those rivals that it beats or that are of its kind."""
    least = _CLOSES * (baseline.power - min(item.fitted.power for item in step))
    begun: dict[str, Step] = {}
    for k, item in enumerate(step):
        name = item.last.effect.name
        if name not in begun and baseline.power - item.fitted.power >= least:
            others = [r for r in step[:k] if r.last.effect.name == name]
            begun[name] = (item, *others, *(r for r in step[k + 1 :]))
    return list(begun.values())[:_BEGINNINGS]


def _evidence(chain: tuple[Step, ...], baseline: Fitted, over: float) -> float:
    last = chain[-1][0].fitted
    places = sum(step[0].choice for step in chain)
    return 0.5 * (baseline.power - last.power) / over - last.price - places


def needed(problem: Problem, chain: tuple[Step, ...], baseline: Fitted) -> tuple[Step, ...]:
    """The chain without effects that those found after them have made superfluous."""
    n, k = len(problem.nominal_rows), 0
    while k < len(chain) - 1:
        full = chain[-1][0].fitted
        rest = [i for i in range(len(full.placed)) if i != k]
        placed, theta = tuple(full.placed[i] for i in rest), tuple(full.theta[i] for i in rest)
        without = refine(problem, placed, theta, full)
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
    same = (item for item in step if item.last.effect.name == best.last.effect.name)
    doubt = best.fitted.power + _LITTLE_OF_NOISE * n
    return tuple(
        dict.fromkeys(i.last.location for i in same if _untold(i, best, n) or i.fitted.power < doubt)
    )


def rivals(step: Step, n: int) -> tuple[Ranked, ...]:
    """The accepted effect and those of other names that the data cannot tell from it; arguments as above."""
    chosen: dict[str, Ranked] = {}
    for item in step:
        if _untold(item, step[0], n):
            chosen.setdefault(item.last.effect.name, item)
    return tuple(chosen.values())


def _untold(item: Ranked, best: Ranked, n: int) -> bool:
    """Whether evidence does not decide between two, or what the form of the better one leaves is larger."""
    left = best.fitted.power - n
    misfit = FORM_DOUBT * left if best.fitted.power > NOISE_SLACK * n else 0.0
    return item.evidence > best.evidence - DECISIVE or item.fitted.power - best.fitted.power < misfit


# Exchange moves: each of several effects against all its rivals, with the others in place.

Step = tuple[Ranked, ...]

_ROUNDS = 3


def exchanged(ranker: Ranker, chain: tuple[Step, ...]) -> tuple[Step, ...]:
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
    for _ in range(_ROUNDS):
        before = [_place(step[0]) for step in chain]
        for _ in before:
            chain = (*chain[1:], _sought_again(ranker, chain))
        if [_place(step[0]) for step in chain] == before:
            break
    return chain


def _sought_again(ranker: Ranker, chain: tuple[Step, ...]) -> Step:
    """Rivals of the first effect given the others, itself among them as the last."""
    problem = ranker.problem
    full, first = chain[-1][0].fitted, chain[0][0]
    placed, theta = (*full.placed[1:], full.placed[0]), (*full.theta[1:], full.theta[0])
    if len(placed) > 1:
        others = refine(problem, placed[:-1], theta[:-1], full)
    else:
        others = nominal_fit(problem)
    present = Ranked(refine(problem, placed, theta, full), 0.0, first.choice)
    found = ranker(others)
    same = [present, *(item for item in found if _place(item) == _place(present))]
    best = min(same, key=lambda item: 0.5 * item.fitted.power + item.fitted.price)
    rivals = [item for item in found if _place(item) != _place(present)]
    return by_evidence([(item.fitted, item.choice) for item in (best, *rivals)], others, problem)


def _place(item: Ranked) -> tuple[str, str]:
    return item.last.effect.name, item.last.location
