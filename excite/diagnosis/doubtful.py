"""What a diagnosis leaves open where the log tells a quantity only about."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS
from excite.doctor.doubt import Doubt
from excite.logs.vocabulary import RIGID_BODY

_IDENTIFIED, _GIVEN = RIGID_BODY


def in_doubt(modelled: Sequence[str], doubts: AbstractSet[Doubt]) -> tuple[str, ...]:
    """Words of ``modelled`` for a log with doubts.

    Effects that are told by what is in doubt are no candidates. Their rest would be given the name of another effect
    as long as bodies are taken as given, so these are identified along.

    Args:
        modelled: the words that the log has.
        doubts: what it tells only about.

    Returns:
        The words to diagnose by.
    """
    words = dict.fromkeys(modelled)
    if any(doubt.of_bodies for doubt in doubts) and _GIVEN in words:
        words = dict.fromkeys(_IDENTIFIED if word == _GIVEN else word for word in modelled)
    told = [effect.name for effect in EFFECTS.values() if effect.told_by & doubts]
    told += [effect.name for effect in FLOATING_EFFECTS.values() if effect.told_by & doubts]
    return tuple(words | dict.fromkeys(told))


def said(doubts: AbstractSet[Doubt]) -> str:
    """The same in a sentence."""
    open_ = " and ".join(doubt.value for doubt in Doubt if doubt in doubts)
    bodies = "; bodies are identified along" if any(doubt.of_bodies for doubt in doubts) else ""
    return f"the log tells only about {open_}: effects that are told by it are not tried{bodies}"
