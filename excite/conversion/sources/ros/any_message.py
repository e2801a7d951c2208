"""Messages of any type, decoded by their own definition: every number of them under the path of its field."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from excite.conversion.sources.ros.gathered import Field, Row

# Longer lists are images, clouds and scans; joints with hands are below a hundred.
_MOST_NUMBERS = 100
_DEEPEST = 4
# A message of more bytes is no state of joints.
MOST_BYTES = 20_000
_NAMES = ("name", "names", "joint_name", "joint_names")
_LEFT_OUT = {"header", "stamp", "covariance", "crc", "reserve"}


def decode_any(message: Any) -> Row:
    """Fields and numbers of a message of a type that nothing is known of.

    Lists of numbers that are as long as a list of names beside them are called after the names.
    """
    fields: list[Field] = []
    numbers: list[float] = []
    _collect("", message, fields, numbers, 0)
    return fields, numbers


def _members(message: Any) -> dict[str, Any]:
    if isinstance(message, Mapping):
        return dict(message)
    names = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", ())
    return {str(name): getattr(message, name) for name in (names or ()) if not str(name).startswith("_")}


def _collect(path: str, value: Any, fields: list[Field], numbers: list[float], depth: int) -> None:
    if isinstance(value, bool | int | float | np.number):
        fields.append(Field(path))
        numbers.append(float(value))
    elif isinstance(value, np.ndarray | list | tuple):
        _list(path, value, (), fields, numbers, depth)
    elif not isinstance(value, str | bytes | None) and depth <= _DEEPEST:
        members = _members(value)
        names = _names_of(members)
        for name, inner in members.items():
            where = f"{path}.{name}" if path else name
            if name in _LEFT_OUT or name.startswith("__"):
                continue
            if isinstance(inner, np.ndarray | list | tuple):
                _list(where, inner, names if len(names) == len(inner) else (), fields, numbers, depth)
            else:
                _collect(where, inner, fields, numbers, depth + 1)


def _names_of(members: Mapping[str, Any]) -> list[str]:
    lists = (members.get(name, ()) for name in _NAMES)
    return next((list(words) for words in lists if _are_words(words)), [])


def _are_words(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(word, str) for word in value)


def _list(path: str, values: Any, names: Any, fields: list[Field], numbers: list[float], depth: int) -> None:
    if not 0 < len(values) <= _MOST_NUMBERS or isinstance(values[0], str | bytes):
        return
    for k, value in enumerate(values):
        where = f"{path}.{names[k]}" if len(names) else f"{path}[{k}]"
        _collect(where, value, fields, numbers, depth + 1)
