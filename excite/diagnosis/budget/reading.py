"""What of a budget may be named beside the verdict of the search for one effect after the other."""

from __future__ import annotations

from collections.abc import Sequence

from excite.diagnosis.answer.budget import Budget, EffectShare, Named
from excite.diagnosis.budget.thresholds import THRESHOLDS


def namable(budget: Budget) -> tuple[Named, ...]:
    """Effects without a rival of another name that surely take more than a trifle of the gap at a place of theirs."""
    return tuple(item for item in budget.named if _alone(item) and _surely(budget, item) >= THRESHOLDS.trifle)


def explained(budget: Budget, effects: Sequence[Named]) -> bool:
    """Whether effects are what the gap is.

    They are if they take most of it together; or most of what has structure, where the largest of all shares is one
    of theirs; or if one surely takes most of what its own place has. One that stands clear at a quiet joint is no
    answer to the gap of another.
    """
    taken = sum(item.share for item in effects)
    if taken >= THRESHOLDS.most:
        return True
    rest, largest = budget.rest, max((item.share for item in effects), default=0.0)
    if taken >= THRESHOLDS.most * (1.0 - rest) and largest >= max(rest, *budget.follows.values(), 0.0):
        return True
    return any(
        item.share >= THRESHOLDS.trifle and _surely(budget, item) >= THRESHOLDS.most for item in effects
    )


def _alone(item: Named) -> bool:
    return item.probability >= THRESHOLDS.probable and all(name == item.effect for name, _ in item.rivals)


def _surely(budget: Budget, item: Named) -> float:
    """The lower end of the 90 % interval of what an effect takes of a channel, where that is most."""
    shares: list[EffectShare] = [s for channel in budget.channels.values() for s in channel.effects]
    mine = (s for s in shares if (s.effect, s.location) == (item.effect, item.location))
    return max((s.interval90[0] for s in mine), default=0.0)
