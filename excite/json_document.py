"""JSON documents as scripts read them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from excite.atomic import write_text
from excite.provenance import stated


def to_json(document: dict[str, Any]) -> str:
    """One JSON document; numbers that JSON cannot hold (NaN, infinity) become null."""
    return json.dumps(finite(document), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(document: dict[str, Any], path: Path) -> Path:
    """Write a JSON document atomically; one of a schema says which command wrote it, where one did."""
    return write_text(path, to_json(with_origin(document)) + "\n")


def with_origin(document: dict[str, Any]) -> dict[str, Any]:
    """A document of a schema with the command that makes it, where one does."""
    return {**document, **stated()} if "schema" in document else document


def finite(value: Any) -> Any:
    """A copy in which numbers that JSON cannot hold are None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
