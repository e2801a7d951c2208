"""Effects that an answer names, with what it says that each takes of which joint's gap."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Stated:
    """An effect that an answer names.

    Attributes:
        effect: its name.
        location: its place.
        tied: places that are said to be as likely, its own not among them.
        shares: of each joint's gap, by joint.
        intervals: 90 % interval of those, by joint, where one is stated.
    """

    effect: str
    location: str
    tied: frozenset[str] = frozenset()
    shares: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, channel: str, share: float | None, interval: Any) -> None:
        """A share of a joint, and its interval if there is a whole one."""
        if share is None:
            return
        self.shares[channel] = float(share)
        if interval is not None and None not in tuple(interval):
            self.intervals[channel] = (float(interval[0]), float(interval[1]))


def of_answer(content: Mapping[str, Any], joints: Collection[str]) -> tuple[Stated, ...]:
    """Effects of an ``excite.blind_answer/1``; a share without a channel is of the joint that is the place."""
    made: dict[tuple[str, str], Stated] = {}
    for item in content["effects"]:
        stated = _stated_effect(made, item)
        channel = item["channel"] or (item["location"] if item["location"] in joints else None)
        if channel is not None:
            stated.add(channel, item["share"], item["interval90"])
    return tuple(made.values())


def of_diagnosis(document: Mapping[str, Any]) -> tuple[Stated, ...]:
    """Effects of an ``excite.diagnosis/1``: the accepted ones, and what its budget names."""
    made: dict[tuple[str, str], Stated] = {}
    for item in document["effects"]:
        _stated_effect(made, item)
    for channel, budget in document.get("budget", {}).items():
        for item in budget["effects"]:
            _stated_effect(made, item).add(channel, item["share"], item.get("interval90"))
    return tuple(made.values())


def _stated_effect(made: dict[tuple[str, str], Stated], item: Mapping[str, Any]) -> Stated:
    """The effect that an item speaks of, made where it is new."""
    key = (item["effect"], str(item["location"]))
    tied = frozenset(item.get("tied_locations", ())) - {key[1]}
    known = made.setdefault(key, Stated(*key, tied))
    known.tied |= tied
    return known
