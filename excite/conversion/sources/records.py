"""Recordings of entries with the same fields in JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording
from excite.conversion.shapes import FEWEST_ROWS, longest_streams, stream_of_arrays
from excite.conversion.sources.arrays import constants
from excite.conversion.sources.source import Source
from excite.formats.file import first_bytes
from excite.formats.tables import seconds

# JSON recordings: columns of numbers, or a list of entries with the same fields (as BAM writes them).

# Text of JSON: read at once it takes a gigabyte.
_MAX_BYTES = 512 * 1024 * 1024
_DEEPEST = 6
# Robots with more joints are not recorded as JSON.
_MOST_JOINTS = 64


class JsonSource(Source):
    """An object of lists, a list of objects, or an object that holds such a list; or one object a line."""

    name: ClassVar[str] = "json"
    what: ClassVar[str] = "JSON"
    limit: ClassVar[int] = _MAX_BYTES
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
        content = _parse_json(path.read_text(encoding="utf-8-sig"), path)
        around, trials = _find_trials(content)
        if trials:
            names = [f"{path.stem}_{k + 1}" for k in range(len(trials))]
            found = [
                _build_recording(path, name, around | trial)
                for name, trial in zip(names, trials, strict=True)
            ]
        else:
            found = [_build_recording(path, path.stem, content)]
        return tuple(found)


def _build_recording(path: Path, name: str, content: Any) -> Recording:
    """The recording that an object holds: lists of numbers as arrays, what else there is by its path."""
    leaves = _leaves(content, "", 0)
    found = {key: _as_array(value) for key, value in leaves.items() if isinstance(value, list) and value}
    arrays = {key: values for key, values in found.items() if values is not None}
    said = {key: value for key, value in leaves.items() if isinstance(value, int | float | str)}
    streams = longest_streams(stream_of_arrays(name, arrays))
    return Recording(str(path), name, streams, said | constants(arrays))


def _find_trials(content: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """A list of trials, each an object of long lists, and what stands beside it; an empty list where there is none.

    Entries that hold a list a quantity with a number a joint are rows of one trial: such lists are short, and of one
    length in all of them.
    """
    lists = content.items() if isinstance(content, dict) else [("", content)]
    for key, value in lists:
        if not isinstance(value, list) or len(value) < 2 or not all(isinstance(one, dict) for one in value):
            continue
        lengths = [max((len(v) for v in one.values() if isinstance(v, list)), default=0) for one in value]
        longer = min(lengths) > _MOST_JOINTS
        if longer or (min(lengths) >= FEWEST_ROWS and len(set(lengths)) > 1):
            around = {k: v for k, v in content.items() if k != key} if isinstance(content, dict) else {}
            return around, value
    return {}, []


def _parse_json(text: str, path: Path) -> Any:
    if path.suffix.lower() in {".jsonl", ".ndjson"}:
        return _parse_lines(text)
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        # One object a line under the other name, too.
        lines = text.lstrip().splitlines()
        if len(lines) < 2 or not lines[0].rstrip().endswith("}"):
            raise
        return _parse_lines(text)


def _parse_lines(text: str) -> list[Any]:
    return [json.loads(line) for line in text.splitlines() if line.strip()]


def _leaves(value: Any, path: str, depth: int, unnamed: int = 0) -> dict[str, Any]:
    """Numbers, words and lists by their paths; of a list of objects a list of each of their leaves.

    The list that holds the rows of a recording gives no name to what is in it, nor does an object in each row; objects
    down to the depth ``unnamed`` do not.
    """
    if depth > _DEEPEST:
        return {}
    if isinstance(value, dict):
        prefix = f"{path}/" if path and depth > unnamed else ""
        inner = (_leaves(one, f"{prefix}{key}", depth + 1, unnamed) for key, one in value.items())
        return {key: leaf for leaves in inner for key, leaf in leaves.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        rows = [_leaves(one, "", depth + 1, 2) if isinstance(one, dict) else {} for one in value]
        return {
            f"{path}/{key}" if path and depth > 1 else key: [row.get(key) for row in rows] for key in rows[0]
        }
    return {path: value}


def _as_array(cells: list[Any]) -> np.ndarray | None:
    """A cell or a list of cells a row as an array, dates as seconds; None for what is neither numbers nor words."""
    width = len(cells[0]) if isinstance(cells[0], list) else 0
    words = isinstance(cells[0][0] if width else cells[0], str)
    empty: Any = "" if words else float("nan")
    full = [([empty] * width if width else empty) if cell is None else cell for cell in cells]
    if words:
        stamps = None if width else seconds([str(cell) for cell in full])
        even = not width or all(isinstance(cell, list) and len(cell) == width for cell in full)
        return stamps if stamps is not None else np.array(full, dtype=str) if even else None
    try:
        return np.array(full, dtype=float)
    except (ValueError, TypeError):
        return None
