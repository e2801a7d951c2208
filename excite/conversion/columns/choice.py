"""Which of several families of columns a channel is made of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from excite.conversion.columns.families import Family, is_measured, of_motor
from excite.conversion.guesses import Guesses


def choose(groups: Sequence[Family], found: Guesses) -> dict[str, Family]:
    """The family for each channel: of several the one with the most joints."""
    chosen: dict[str, Family] = {}
    for family in groups:
        if not family.target or not family.placed.columns:
            continue
        if family.target in chosen:
            other = chosen[family.target]
            text = f"{family.columns[0]} …"
            alike = len(family.placed.columns) == len(other.placed.columns)
            side = of_motor(family) == of_motor(other) and is_measured(family) == is_measured(other)
            if alike and side and family.target in ("q", "tau", "i"):
                found.ask(
                    f"{family.target} may be {other.columns[0]} … or {text}",
                    f'columns: {{{family.target}: "{_pattern(other)}"}}',
                )
            continue
        chosen[family.target] = family
    if "q" not in chosen and "q_cmd" in chosen and "tau" not in chosen and "i" not in chosen:
        # A motion that was planned and has no measured twin.
        chosen["q"] = replace(chosen.pop("q_cmd"), target="q")
        found.facts.append(("q", chosen["q"].columns[0], "planned positions: no measured ones are there"))
    if "tau" not in chosen and "i" not in chosen and "tau_cmd" in chosen:
        chosen["tau"] = replace(chosen.pop("tau_cmd"), target="tau")
        found.facts.append(("tau", chosen["tau"].columns[0], "commanded torques: no measured ones are there"))
    return chosen


def _pattern(family: Family) -> str:
    """A column's name with its number as a pattern."""
    name = family.columns[0]
    if (joint := next((j for j, column in family.placed.columns.items() if column == name), "")) in name:
        return name.replace(joint, "{joint}") if joint else name
    return (
        re.sub(r"\d+(?!.*\d)", "{n0}" if re.search(r"0(?!.*\d)", name) else "{n}", name, count=1)
        if len(family.columns) > 1
        else name
    )
