"""How a setting is declared: once, with default, unit, bounds and meaning, and checked by what was declared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, field, fields
from typing import TYPE_CHECKING, Any

from excite.errors import InputError
from excite.reading.number import check_number

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

SOURCE = "settings"


def number(
    default: float | None, unit: str, low: float, high: float, what: str, *, optional: bool = False
) -> Any:
    """A number within bounds, which are allowed themselves; ``optional`` ones may be None, for "none"."""
    declared = {"unit": unit, "low": low, "high": high, "what": what, "optional": optional}
    return field(default=default, metadata=declared)


def word(default: str, options: tuple[str, ...], what: str) -> Any:
    """One of some words."""
    return field(default=default, metadata={"options": options, "what": what})


def shares_by_link(low: float, high: float, what: str) -> Any:
    """Shares of single segments by their link, none by default."""
    return field(default_factory=dict, metadata={"shares": (low, high), "what": what})


def share_limits(settings: DataclassInstance, name: str) -> tuple[float, float]:
    """Least and greatest value that a setting of :func:`shares_by_link` takes."""
    low, high = next(item.metadata["shares"] for item in fields(settings) if item.name == name)
    return float(low), float(high)


def stated(unit: str, what: str) -> dict[str, str]:
    """Metadata of what has a form of its own, such as an array, and is checked where it is used."""
    return {"of": unit, "what": what}


def check_settings(settings: DataclassInstance) -> None:
    """Raise InputError, which names the setting, for a value that its declaration does not allow."""
    for item in fields(settings):
        value = getattr(settings, item.name)
        if "options" in item.metadata:
            _check_word(item, value)
        elif "shares" in item.metadata:
            _check_shares(item, value)
        elif "unit" in item.metadata and not (value is None and item.metadata["optional"]):
            _check_number(item, value)


def _check_word(item: Field[Any], value: Any) -> None:
    options = item.metadata["options"]
    if value not in options:
        raise InputError(
            f"is {value!r}", source=SOURCE, field=item.name, remedy="choose " + " or ".join(options)
        )


def _check_shares(item: Field[Any], shares: Mapping[str, float]) -> None:
    low, high = item.metadata["shares"]
    for link, share in shares.items():
        check_number(share, f"{item.name}.{link[:60]}", low, high, source=SOURCE)


def _check_number(item: Field[Any], value: Any) -> None:
    low, high, unit = item.metadata["low"], item.metadata["high"], item.metadata["unit"]
    valid = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not valid or not low <= value <= high:
        raise InputError(
            f"is {value!r}",
            source=SOURCE,
            field=item.name,
            remedy=f"choose {low:g} … {high:g}" + ("" if unit == "1" else f" {unit}"),
        )
