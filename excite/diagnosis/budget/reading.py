"""What a budget says of a gap: which of its effects stand clear, and whether they are what the gap is."""

from __future__ import annotations

from collections.abc import Sequence

from excite.diagnosis.answer.budget import Budget, Named
from excite.diagnosis.budget.thresholds import THRESHOLDS


def explained(budget: Budget, effects: Sequence[Named]) -> bool:
    """Whether effects are what the gap is.

    They are if they take most of it together; or most of what has structure, where that is no trifle, the largest share
    that follows anything is one of theirs, and at its place no less than what has no name there; or if those that lead
    their own places so, with most of what has structure there, are no trifle together: what other joints have above
    their noise says nothing of these. With the lower end of an interval as most of a place instead, a UR10e that a run
    of 20 s judges loses load-dependent friction of 380 and 193 nats, and no verdict on 82 drawn arms is another.
    """
    taken = sum(item.share for item in effects)
    if taken >= THRESHOLDS.most:
        return True
    first = max(effects, key=lambda item: item.share, default=None)
    structured = taken >= max(THRESHOLDS.most * (1.0 - budget.rest), THRESHOLDS.trifle)
    structured = structured and first is not None and first.share >= max([*budget.follows.values(), 0.0])
    if structured and first is not None and _leads(budget, first):
        # Of much that stays open a name that is not sure says nothing.
        if first.probability >= THRESHOLDS.probable or taken >= _open(budget):
            return True
    there = (item.share for item in effects if _leads(budget, item, most=True))
    return sum(there) >= THRESHOLDS.trifle


def _open(budget: Budget) -> float:
    """What follows nothing and yet stands above the noise, over all channels."""
    return sum(
        channel.weight * channel.rest
        for channel in budget.channels.values()
        if channel.rest * (channel.gap**2 - channel.noise_floor**2) > channel.noise_floor**2
    )


def _leads(budget: Budget, item: Named, *, most: bool = False) -> bool:
    """Whether an effect takes no less of a channel than what follows nothing, or has no name, there.

    And ``most`` of what has structure there.
    """
    return any(
        s.share >= max([channel.rest, *(u.share for u in channel.unnamed)])
        and (not most or s.share >= THRESHOLDS.most * (1.0 - channel.rest))
        for channel in budget.channels.values()
        for s in channel.effects
        if (s.effect, s.location) == (item.effect, item.location)
    )


def takes_its_place(budget: Budget, item: Named) -> bool:
    """Whether an effect surely takes something of the gap of its own joint, and no less there than has no name.

    Of what acts on several joints: of any of them. Of a Panda that runs into something at joint 3 a constant takes less
    than what is left there, and is its mean.
    """
    own = budget.channels.get(item.location)
    places = budget.channels.values() if own is None else (own,)
    return any(
        s.interval90[0] > 0.0 and s.share >= max([channel.rest, *(u.share for u in channel.unnamed)])
        for channel in places
        for s in channel.effects
        if (s.effect, s.location) == (item.effect, item.location)
    )


def alone(item: Named) -> bool:
    """Whether an effect has no rival of another name."""
    return item.probability >= THRESHOLDS.probable and all(name == item.effect for name, _ in item.rivals)
