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
    """The remedy of something that is to be multiplied by about a factor; exactly by the slip's that is near it.

    Args:
        what: the quantity, in words.
        value: the mass that is stated [kg]; None of anything else.
        factor: what makes it usual.
    """
    slip = _nearest_slip(1.0 / factor)
    exact = factor if slip is None else 1.0 / slip
    better = "" if value is None else f", {value * exact:.3g} kg"
    return f"{what} × {exact:.2g}{better}" + slip_in_words(1.0 / factor)


def slip_in_words(factor: float) -> str:
    """What a factor looks like; empty where it is near no slip."""
    slip = _nearest_slip(factor)
    if slip is None:
        return ""
    words = _SLIPS[max(slip, round(1.0 / slip))]
    return f" (looks like {words}{', the other way round' if slip < 1e-2 else ''})"


def _nearest_slip(factor: float) -> float | None:
    """The slip that a factor is nearest to; None where it is near none.

    What is usual is known to a factor of three: half a decade for units, less for a digit more or less.
    """
    slips = [slip for size in _SLIPS for slip in (size, 1.0 / size)]
    nearest = min(slips, key=lambda slip: abs(math.log10(factor / slip)))
    decades = 0.5 if abs(math.log10(nearest)) > 2.5 else 0.25
    return nearest if abs(math.log10(factor / nearest)) < decades else None


def numbers_in_words(values: Array) -> str:
    """The numbers of a vector as an attribute holds them."""
    return " ".join(f"{value:.4g}" for value in values)
