"""What is said of arms with a little of everything, compared with the true shares."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from excite.blind.case_score import same_effect
from excite.blind.detectability import DETECTABLE
from excite.blind.entry.stated import Stated
from excite.blind.hidden import Answer, HiddenEffect

LARGE = 0.1
"""Share of a joint's gap from which on an effect is to be found."""


@dataclass(frozen=True)
class SharePair:
    """An effect and a joint of whose gap it takes a tenth or more.

    Attributes:
        effect: name of the effect.
        location: its place.
        joint: the joint.
        share: the true share of that joint's gap.
        found: 1 where it is named at its place, 1/k where that is one of k places said to be alike, else 0.
        stated: the share that is stated, None where none is.
        inside: whether the true share is inside the stated 90 % interval, None where none is stated.
    """

    effect: str
    location: str
    joint: str
    share: float
    found: float
    stated: float | None
    inside: bool | None


@dataclass(frozen=True)
class MixtureScore:
    """One case.

    Attributes:
        case: its name.
        pairs: all effects that are to be found, by joint.
        right: for each effect that is named, how right: 1, 1/k as in ``found``, or 0 where it is not there.
        right_large: the same of those that are said to take a tenth or more of some joint's gap.
    """

    case: str
    pairs: tuple[SharePair, ...]
    right: tuple[float, ...]
    right_large: tuple[float, ...]


def score_mixture(case: str, answer: Answer, stated: Sequence[Stated]) -> MixtureScore:
    """Compare what is said with the true shares.

    An effect is to be found where it takes :data:`LARGE` or more of the gap of a joint and stands above the noise
    there as far as :data:`~excite.blind.detectability.DETECTABLE` asks.

    Args:
        case: name of the case.
        answer: what is hidden.
        stated: what is said.

    Returns:
        The comparison.
    """
    pairs = []
    for hidden in answer.effects:
        best = max(stated, key=lambda item: _effect_credit(hidden, item), default=None)
        credit = 0.0 if best is None else _effect_credit(hidden, best)
        for joint, share in hidden.shares.items():
            there = answer.joints[joint]
            if share < LARGE or share**0.5 * there.gap < DETECTABLE * there.noise:
                continue
            said = best.shares.get(joint) if best is not None and credit else None
            interval = best.intervals.get(joint) if best is not None and credit else None
            inside = None if interval is None else interval[0] <= share <= interval[1]
            pairs.append(SharePair(hidden.effect, hidden.location, joint, share, credit, said, inside))
    right = [max((_effect_credit(hidden, item) for hidden in answer.effects), default=0.0) for item in stated]
    large = [
        mark
        for mark, item in zip(right, stated, strict=True)
        if max(item.shares.values(), default=0.0) >= LARGE
    ]
    return MixtureScore(case, tuple(pairs), tuple(right), tuple(large))


def _effect_credit(hidden: HiddenEffect, said: Stated) -> float:
    if not same_effect(hidden.effect, said.effect):
        return 0.0
    if hidden.location != said.location and hidden.location not in said.tied:
        return 0.0
    return 1.0 / (1 + len(said.tied))


def mixture_figures(scores: Iterable[MixtureScore]) -> dict[str, float | None]:
    """Figures of all such cases; None where nothing is to be counted."""
    scores = tuple(scores)
    pairs = [pair for score in scores for pair in score.pairs]
    # An effect of several joints counts once.
    found = {(s.case, p.effect, p.location): p.found for s in scores for p in s.pairs}
    stated = [pair for pair in pairs if pair.stated is not None]
    inside = [pair.inside for pair in pairs if pair.inside is not None]
    weight = sum(pair.share for pair in pairs)
    return {
        "everything_cases": float(len(scores)),
        "everything_effects": float(len(found)),
        "everything_share_found": sum(p.share * p.found for p in pairs) / weight if weight else None,
        "everything_found": _mean_or_none(list(found.values())),
        "everything_named_right": _mean_or_none([mark for score in scores for mark in score.right]),
        "everything_large_named_right": _mean_or_none(
            [mark for score in scores for mark in score.right_large]
        ),
        "everything_share_error_median": median(abs((p.stated or 0.0) - p.share) for p in stated)
        if stated
        else None,
        "everything_share_inside": _mean_or_none([float(mark) for mark in inside]),
    }


def _mean_or_none(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
