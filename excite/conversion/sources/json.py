"""JSON recordings: columns of numbers, or a list of entries with the same fields (as BAM writes them)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes.array_streams import longest, stream_of_arrays
from excite.conversion.sources.npz import constants
from excite.conversion.sources.source import Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# Ten times what is read as JSON elsewhere is still read at once in a gigabyte.
_MAX_BYTES = 512 * 1024 * 1024
_DEEPEST = 6


class JsonSource(Source):
    """An object of lists, a list of objects, or an object that holds such a list; or one object a line."""

    name: ClassVar[str] = "json"
    summary: ClassVar[str] = "JSON (.json, .jsonl)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if not path.is_file():
            return False
        if path.suffix.lower() in {".json", ".jsonl", ".ndjson"}:
            return True
        return first_bytes(path, 64).lstrip()[:1] == b"{" and path.suffix.lower() not in {".yaml", ".yml"}

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            text = path.read_text(encoding="utf-8-sig")
            content = _parsed(text, path)
        except (OSError, ValueError, RecursionError, MemoryError) as error:
            raise damaged(path, error, "JSON") from error
        arrays: dict[str, Any] = {}
        said: dict[str, object] = {}
        collect("", content, arrays, said, 0)
        streams = longest(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams, said | constants(arrays)),)


def _parsed(text: str, path: Path) -> Any:
    if path.suffix.lower() in {".jsonl", ".ndjson"}:
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    return json.loads(text)


def collect(name: str, value: Any, arrays: dict[str, Any], said: dict[str, object], depth: int) -> None:
    """Numbers in lists to ``arrays``, single values to ``said``, by their paths."""
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            collect(f"{name}/{key}" if name else str(key), inner, arrays, said, depth + 1)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for key in value[0]:
            cells = [entry.get(key) if isinstance(entry, dict) else None for entry in value]
            inner = f"{name}/{key}" if name and depth > 1 else str(key)
            if isinstance(value[0][key], dict):
                collect(
                    inner, [cell if isinstance(cell, dict) else {} for cell in cells], arrays, said, depth + 1
                )
            elif isinstance(value[0][key], list) and value[0][key] and isinstance(value[0][key][0], dict):
                _of_motors(inner, cells, arrays)
            else:
                _numbers(inner, cells, arrays)
    elif isinstance(value, list):
        _numbers(name, value, arrays)
    elif isinstance(value, int | float | str):
        said[name] = value


def _of_motors(name: str, cells: list[Any], arrays: dict[str, Any]) -> None:
    """Entries that hold an object a motor: each of its numbers as an array with a column a motor."""
    count = len(cells[0])
    whole = [cell if isinstance(cell, list) and len(cell) == count else [{}] * count for cell in cells]
    for key, first in cells[0][0].items():
        if isinstance(first, int | float | str):
            missing = "" if isinstance(first, str) else None
            _numbers(f"{name}/{key}", [[motor.get(key, missing) for motor in cell] for cell in whole], arrays)


def _numbers(name: str, cells: list[Any], arrays: dict[str, Any]) -> None:
    width = len(cells[0]) if cells and isinstance(cells[0], list) else 0
    empty = [float("nan")] * width if width else float("nan")
    first = cells[0][0] if width else (cells[0] if cells else None)
    if isinstance(first, str):
        # Names of joints, or a word in each row.
        texts = [cell if cell is not None else [""] * width if width else "" for cell in cells]
        if not width or all(isinstance(text, list) and len(text) == width for text in texts):
            arrays[name] = np.array(texts, dtype=str)
        return
    try:
        arrays[name] = np.array([empty if cell is None else cell for cell in cells], dtype=float)
    except (ValueError, TypeError):
        return
