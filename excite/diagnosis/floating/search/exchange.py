"""Exchange moves: each of several effects against all its rivals, with the others in place."""

from __future__ import annotations

from excite.diagnosis.floating.search.ranking import Ranked, Ranker, by_evidence
from excite.diagnosis.floating.search.refinement import nominal_fit, refine

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
