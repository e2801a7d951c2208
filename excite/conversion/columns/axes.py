"""Axes that are called by the letter that accelerations have: ``A1`` … ``A6`` of KUKA's and ABB's controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from excite.conversion.columns.families import TARGETS, Family
from excite.conversion.columns.words import Clue
from excite.conversion.guesses import Guesses

_LETTER = "a"


def axes_as_positions(
    found: Guesses, groups: Sequence[Family], clues: Mapping[str, Clue], known: set[str]
) -> list[Family]:
    """The families, with columns of axes as positions where no others are there.

    A recording of accelerations has positions, too; one of axes' positions calls them by their axes alone.

    Args:
        found: what is known; the guess is added.
        groups: the families.
        clues: what the columns' names say.
        known: channels that the map states.
    """
    if "q" in known or any(family.target == "q" for family in groups):
        return list(groups)
    measured = next((f for f in groups if f.quantity == "a" and f.target == "a" and f.stem == _LETTER), None)
    if measured is None:
        return list(groups)
    found.facts.append(
        ("q", f"{measured.columns[0]} …", "axes by their letter: no other positions are there")
    )
    return [
        replace(family, quantity="q", target=TARGETS["q", clues[family.columns[0]].commanded])
        if family.quantity == "a" and _LETTER in family.stem.split("_")
        else family
        for family in groups
    ]
