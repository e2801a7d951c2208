"""JSON documents as scripts read them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from excite.atomic import write_text


def to_json(document: dict[str, Any]) -> str:
    """One JSON document; numbers that JSON cannot hold (NaN, infinity) become null."""
    return json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(document: dict[str, Any], path: Path) -> Path:
    """Write a JSON document atomically."""
    return write_text(path, to_json(document) + "\n")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
