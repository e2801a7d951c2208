"""JSON files as objects, strictly: what a document says twice, or says in numbers that are none, is refused."""

from __future__ import annotations

import json
import reprlib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from excite.errors import InputError
from excite.reading.file import read_text

# The largest document that is written here, the identification of a humanoid from 2000 motions, has 6 MB.
MAX_JSON_BYTES = 256 * 1024 * 1024

# Errors whose input says nothing: the object around a field, or one that the sentence names.
_SAID_ALREADY = frozenset({"missing", "value_error", "too_long", "string_unicode"})

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
    return json.loads(text, object_pairs_hook=_object, parse_constant=_constant)


def checked(
    model: type[_Model],
    content: object,
    path: Path,
    *,
    remedy: str = "write it again",
    error: type[InputError] = InputError,
) -> _Model:
    """Content of a document as a model of its fields; raises ``error`` that names the first field at fault."""
    try:
        return model.model_validate(content)
    except ValidationError as reason:
        first = reason.errors(include_url=False)[0]
        said = first["msg"].removeprefix("Value error, ")
        if first["type"] not in _SAID_ALREADY:
            # Not all of it: a value may be megabytes long, or nested as deep as a reader goes.
            said += f", got {' '.join(reprlib.repr(first['input']).split())[:60]}"
        field = ".".join(str(part)[:60] for part in first["loc"])
        raise error(said, source=path, field=field or None, remedy=remedy) from reason


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _Refused(f"{twice[:60]!r} stands twice")
    return content


def _constant(name: str) -> Any:
    raise _Refused(f"{name} is no number")
