"""Columns whose names say one quantity and state a unit of another, as ``knee_vel_Nm``: they are asked about."""

from __future__ import annotations

from excite.conversion.columns.unit_words import QUANTITY_OF_UNIT
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.mapping import Map

_CALLED = {
    "q": "positions",
    "v": "velocities",
    "a": "accelerations",
    "tau": "torques or forces",
    "i": "currents",
    "volt": "voltages",
}
_USUAL = {"q": "rad", "v": "rad/s", "a": "rad/s2", "tau": "N·m", "i": "A"}


def ask_for_kind(found: Guesses, items: list[Mapped], named: str, mapping: Map) -> None:
    """Ask what columns of one channel are that state a unit of another quantity.

    An angle's unit of velocities may be short for its rate, which the positions' derivative tells.

    Args:
        found: what is known of the columns; a question is added.
        items: the columns.
        named: the unit that their names state; empty for none.
        mapping: what it scales is in a unit that a person has thought of.
    """
    channel, is_of = items[0].channel, QUANTITY_OF_UNIT.get(named, "")
    own = channel.partition("_")[0]
    if own not in _USUAL or is_of in ("", "time", own) or (own, is_of) == ("v", "q"):
        return
    if {channel, *(item.target for item in items)} & set(mapping.scale):
        return
    found.ask(
        f"{items[0].source} … are {_CALLED[own]} by their names and state {named}, a unit of {_CALLED[is_of]}",
        f"units: {{{channel}: {_USUAL[own]}}} or what they are in, scale: {{{channel}: FACTOR}} to {_USUAL[own]}, or "
        f'ignore: ["{common_beginning(items)}*"]',
    )


def ask_for_rate(found: Guesses, items: list[Mapped], named: str) -> None:
    """Ask for the unit of velocities that state one of positions, where nothing else tells it."""
    if QUANTITY_OF_UNIT.get(named) == "q":
        found.ask(
            f"{items[0].source} … are velocities by their names and state {named}, a unit of positions",
            f"units: {{{items[0].channel}: {named}/s}}",
        )


def common_beginning(items: list[Mapped]) -> str:
    """What the columns' names begin with, all of them; none of it means anything else in a pattern."""
    first, last = (end(item.source for item in items) for end in (min, max))
    same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same].rstrip("[0123456789") or first[:same]
