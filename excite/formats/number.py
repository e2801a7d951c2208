"""Numbers that people hand over as settings: finite, of their kind, within stated bounds."""

from __future__ import annotations

import math
from numbers import Integral, Real

import numpy as np

from excite.errors import InputError

# Seeds are written into files, where they stay whole up to here.
_LARGEST_SEED = 2**63 - 1


def check_number(
    value: object, field: str, low: float, high: float, unit: str = "", *, source: object = None
) -> float:
    """A number from ``low`` to ``high``, both allowed; raises InputError that names the field.

    Args:
        field: name of the setting.
        low: smallest value.
        high: largest value.
        unit: of it, for the error.
    """
    number = _real_number(value)
    if not low <= number <= high:
        remedy = f"choose {low:g} to {high:g} {unit}".rstrip()
        raise InputError(f"is {shorten_value(value)}", source=source, field=field, remedy=remedy)
    return number


def check_count(value: object, field: str, low: int, high: int) -> int:
    """A whole number from ``low`` to ``high``, both allowed; raises InputError that names the field."""
    number = int(value) if isinstance(value, Integral) and not isinstance(value, bool) else low - 1
    if not low <= number <= high:
        remedy = f"choose a whole number, {low} to {high}"
        raise InputError(f"is {shorten_value(value)}", field=field, remedy=remedy)
    return number


def check_seed(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    """The sequence of a seed; raises InputError for a number that is none."""
    if isinstance(seed, np.random.SeedSequence):
        return seed
    return np.random.SeedSequence(check_count(seed, "seed", 0, _LARGEST_SEED))


def shorten_value(value: object) -> str:
    """A value in an error, of a length that can be read."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _real_number(value: object) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf
