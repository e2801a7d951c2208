"""JSON files as objects, strictly: what a document says twice, or says in numbers that are none, is refused."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from excite.errors import InputError
from excite.finding import list_names
from excite.reading.file import read_text

# The largest document that is written here, the identification of a humanoid from 2000 motions, has 6 MB.
MAX_JSON_BYTES = 256 * 1024 * 1024

# Missing fields that are named in one line.
_MOST_NAMED = 12
# Errors whose input says nothing: the object around a field, or one that the sentence names.
_SAID_ALREADY = frozenset({"value_error", "too_long"})
_KINDS = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "an object"),
    "list_type": "a list",
    "float_type": "a number",
    "finite_number": "a finite number",
    **dict.fromkeys(("int_type", "int_from_float"), "a whole number"),
    "bool_type": "true or false",
    "string_type": "text",
    "string_unicode": "text that UTF-8 can hold",
    "string_pattern_mismatch": "text that can be shown",
}

_Model = TypeVar("_Model", bound=BaseModel)


class _Refused(ValueError):
    """Something that JSON allows and that no document here holds."""


def read_json(
    path: str | Path,
    *,
    schema: str | None = None,
    remedy: str = "write it again",
    error: type[InputError] = InputError,
) -> dict[str, Any]:
    """The object that a JSON file holds.

    Args:
        path: of the file.
        schema: what its field ``schema`` has to be; None where it has none.
        remedy: what to do where the file is wrong.
        error: class of the errors.

    Raises:
        InputError: of the class ``error``: the file cannot be read, is no JSON or no object, holds a key twice or NaN,
            or its schema is another.
    """
    path = Path(path)
    text = read_text(path, limit=MAX_JSON_BYTES, error=error)
    try:
        content = parse_json(text)
    except RecursionError as reason:
        raise error("is nested too deep", source=path, remedy=remedy) from reason
    except ValueError as reason:
        line = " ".join(str(reason).split())
        raise error(f"is no JSON ({line[:160]})", source=path, remedy=remedy) from reason
    if not isinstance(content, dict):
        raise error("is no JSON object", source=path, remedy=remedy)
    if schema is not None and content.get("schema") != schema:
        found = repr(content.get("schema"))[:60]
        raise error(f"schema is {found}, not {schema!r}", source=path, field="schema", remedy=remedy)
    return content


def parse_json(text: str) -> Any:
    """What a JSON text says; raises ValueError, also for a key that stands twice and for NaN, or RecursionError."""
    return json.loads(text, object_pairs_hook=_build_object, parse_constant=_refuse_constant)


def check_content(
    model: type[_Model],
    content: object,
    path: Path,
    *,
    remedy: str = "write it again",
    error: type[InputError] = InputError,
) -> _Model:
    """Content of a document as a model of its fields; raises ``error`` for what is missing or the first fault."""
    try:
        return model.model_validate(content)
    except ValidationError as reason:
        faults = reason.errors(include_url=False)
        first = faults[0]
        field = _fault_place(first)
        others = [_fault_place(fault) for fault in faults[1:] if fault["type"] == "missing"]
        more = (
            f", and so are {list_names(others, _MOST_NAMED)}" if others and first["type"] == "missing" else ""
        )
        raise error(_in_words(first) + more, source=path, field=field or None, remedy=remedy) from reason


def _fault_place(fault: Mapping[str, Any]) -> str:
    return ".".join(str(part)[:60] for part in fault["loc"])


def _in_words(fault: Mapping[str, Any]) -> str:
    """What is wrong with a field, of what pydantic says about it."""
    kind = fault["type"]
    if kind == "missing":
        return "is missing"
    # Not all of it: a value may be megabytes long, or nested as deep as a reader goes.
    found = "null" if fault["input"] is None else " ".join(reprlib.repr(fault["input"]).split())[:60]
    if kind in _KINDS:
        return f"is {found}, not {_KINDS[kind]}"
    said = fault["msg"].removeprefix("Value error, ")
    said = said.removeprefix("Input ")
    said = said[:1].lower() + said[1:]
    return said if kind in _SAID_ALREADY else f"{said}, got {found}"


def _build_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _Refused(f"{twice[:60]!r} stands twice")
    return content


def _refuse_constant(name: str) -> Any:
    raise _Refused(f"{name} is no number")
