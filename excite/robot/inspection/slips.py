"""Numbers of a description in words: vectors, and factors that look like slips of unit or decimal point."""

from __future__ import annotations

import math
from collections.abc import Mapping

from excite.arrays import Array

# By the factor that they make of a mass or of an inertia.
_SLIPS: Mapping[float, str] = {
    10.0: "a decimal point",
    100.0: "a decimal point",
    1e3: "grams for kilograms",
    1e4: "kg·cm² for kg·m²",
    1e6: "kg·mm² for kg·m²",
    1e7: "g·cm² for kg·m²",
    1e9: "g·mm² for kg·m²",
}


def by_factor(what: str, value: float | None, factor: float) -> str:
    """The remedy of something that is off by a factor: a slip of unit or decimal point where it is near one."""
    better = "" if value is None else f", {value * factor:.3g} kg"
    return f"{what} × {factor:.2g}{better}" + slip_in_words(1.0 / factor)


def slip_in_words(factor: float) -> str:
    """What a factor looks like, in words; empty where it is no slip."""
    for size, words in _SLIPS.items():
        if abs(math.log10(max(factor, 1.0 / factor) / size)) < 0.25:
            return f" (looks like {words if factor > 1.0 or size < 1e3 else words + ', the other way round'})"
    return ""


def numbers_in_words(values: Array) -> str:
    return " ".join(f"{value:.4g}" for value in values)
