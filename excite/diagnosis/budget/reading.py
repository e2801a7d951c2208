"""A verdict as a reading of the budget: what takes the largest share, and whether it has a name."""

from __future__ import annotations

from dataclasses import dataclass

from excite.diagnosis.answer.budget import NOT_REPEATED, Budget, Named
from excite.diagnosis.answer.result import Verdict
from excite.diagnosis.budget.thresholds import THRESHOLDS


@dataclass(frozen=True)
class Reading:
    """What a budget says.

    Attributes:
        verdict: effect, ambiguous, unknown or none.
        effects: what is named, largest share first; rivals leave it open which of two names the first has.
        place: channel of the largest share without a name, None where there is none.
    """

    verdict: Verdict
    effects: tuple[Named, ...]
    place: str | None


def read(budget: Budget, structured: tuple[str, ...], *, open_name: bool) -> Reading:
    """Read a budget.

    Args:
        budget: the budget.
        structured: channels that stand above the noise with all effects, the clearest first.
        open_name: whether the first effect has another name that means the same in any motion.
    """
    effects = tuple(item for item in budget.named if _worth_naming(budget, item))
    shares = _without_a_name(budget, structured)
    place = max(shares, key=lambda name: shares[name], default=None)
    if not effects:
        return Reading("unknown" if structured else "none", (), structured[0] if structured else None)
    named, unnamed = sum(max(item.share, 0.0) for item in effects), sum(shares.values())
    most = named >= THRESHOLDS.most * (named + unnamed)
    if not most and not any(_stands_clear(budget, item) for item in effects):
        return Reading("unknown", (), place)
    first = effects[0]
    rivals = any(name != first.effect for name, _ in first.rivals)
    return Reading("ambiguous" if rivals or open_name else "effect", effects, place)


def _worth_naming(budget: Budget, item: Named) -> bool:
    """Whether an effect is likely, or one of several that are, and takes a share of some channel."""
    likely = item.probability >= THRESHOLDS.probable or bool(item.rivals)
    return likely and max(_shares(budget, item), default=0.0) >= THRESHOLDS.unnamed


def _stands_clear(budget: Budget, item: Named) -> bool:
    """Whether an effect takes most of the gap at its own place, and that is not a trifle of the whole."""
    return item.share >= THRESHOLDS.trifle and max(_shares(budget, item), default=0.0) >= THRESHOLDS.most


def _shares(budget: Budget, item: Named) -> list[float]:
    """What an effect takes of each channel."""
    return [
        share.share
        for channel in budget.channels.values()
        for share in channel.effects
        if (share.effect, share.location) == (item.effect, item.location)
    ]


def _without_a_name(budget: Budget, structured: tuple[str, ...]) -> dict[str, float]:
    """Share of the whole gap that each channel has left which follows something, or clearly is no noise."""
    found = {}
    for name, channel in budget.channels.items():
        follows = sum(item.share for item in channel.unnamed if item.follows != NOT_REPEATED)
        left = max(1.0 - sum(item.share for item in channel.effects), 0.0)
        found[name] = channel.weight * (left if name in structured else min(follows, left))
    return found
