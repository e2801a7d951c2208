"""What a budget's figures leave open, in words: intervals that say little, and a gap that lies elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

# What is said wherever intervals of shares are shown.
HELD = (
    "90 % intervals of shares hold less than that: by blocks left out they held 72 % of the truth on ten simulated "
    "arms with many effects, and 26 % on other such arms"
)
# Wider intervals are worth a word.
_WIDE = 0.5


# Shares that differ by more than this are explained.
_DIFFERS = 0.1


def doubt_of_share(share: float | None, low: float | None, high: float | None) -> str:
    """Why a share and its interval do not seem to fit each other, or say little; empty where they do not.

    Args:
        share: of a channel's gap above its noise, 0…1; None where it was not computed.
        low: lower end of its 90 % interval; None where it was not computed.
        high: upper end, alike.

    A number that is not finite counts as not computed.
    """
    if share is None or low is None or high is None or not math.isfinite(share + low + high):
        return ""
    if share < 0.0:
        return "does harm on the trials that judge"
    if low <= 0.0 < share:
        return "may be nothing: too few stretches of the record show it for more"
    if high - low > _WIDE:
        return "known roughly: few stretches of the record show it"
    if not low <= share <= high:
        return "the trials that judge show it otherwise than the rest of the record"
    return ""


def left_elsewhere(
    gaps: Mapping[str, tuple[float, float]], weights: Mapping[str, float], modelled: Sequence[str]
) -> str:
    """Why the budget finds the gap at another joint than the gaps by channel do; empty where both find it at one.

    Each fits the bodies anew, and the motion of one body makes torques at several joints: what no bodies explain, such
    as a gain of the torques of one joint, a fit may leave at that joint or at the one before it.

    Args:
        gaps: by channel, the gap without effects and its noise floor, both in the channel's unit.
        weights: by channel, its share of the whole gap in the budget.
        modelled: what the model had before the first effect; of bodies that were not fitted nothing is said.
    """
    excess = {name: before / max(floor, 1e-300) for name, (before, floor) in gaps.items()}
    here, there = (max(table, key=lambda name: table[name], default="") for table in (weights, excess))
    if "rigid_body" not in modelled or not here or here == there:
        return ""
    if weights[here] <= 0.0 or excess.get(here, 0.0) >= excess[there]:
        return ""
    return (
        f"the budget counts the gap where most of it lies at {here}, before and after count it where most lies at "
        f"{there}: bodies are fitted anew in both, and what they do not explain may be left at one joint or at another"
    )


def named_beside_closed(named: float, closed: float | None, *, accepted: bool) -> str:
    """Why the parts with a name are not what the accepted effects close; empty where both say nearly the same.

    Args:
        named: share of the whole gap that the budget gives to effects.
        closed: share of it that the accepted effects close; None where it was not computed.
        accepted: whether any was.
    """
    if closed is None or abs(named - closed) <= _DIFFERS:
        return ""
    taken = f"the accepted effects close {100.0 * closed:.0f} %" if accepted else "no effect was accepted"
    return (
        f"here named effects take {100.0 * named:.0f} %, and {taken}: both are right; the first counts all that "
        "one fit of everything together finds, the motion alone and each joint by its own power; the second what the "
        "effects that stand clear leave of all rows, each joint by its own signal"
    )
