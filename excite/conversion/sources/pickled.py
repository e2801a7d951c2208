"""Pickles of plain data (``.pkl``), and arrays in which numpy pickled a dictionary: read without running anything."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.sources.npz import recordings_of
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes
from excite.reading.plain_pickle import PICKLE_FAULTS, PlainUnpickler

_MAX_BYTES = 2_000_000_000
_DEEPEST = 8
_ARRAY = b"\x93NUMPY"


class PickleSource(Source):
    """Dictionaries and lists of numbers and numpy arrays, by trial or by sample."""

    name: ClassVar[str] = "pickle"
    summary: ClassVar[str] = "pickles of numbers and numpy arrays alone (.pkl, .pickle)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if not path.is_file():
            return False
        if path.suffix.lower() == ".npy":
            return _is_pickled_array(path)
        return path.suffix.lower() in {".pkl", ".pickle", ".p"}

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            with path.open("rb") as stream:
                if first_bytes(path, len(_ARRAY)) == _ARRAY:
                    first = np.lib.format.read_magic(stream) == (1, 0)
                    header = (
                        np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
                    )
                    header(stream)
                content = PlainUnpickler(stream).load()
            trials = _trials(gathered(content, 0))
        except PICKLE_FAULTS as error:
            text = " ".join(str(error).split()) or type(error).__name__
            raise LogError(
                f"is a pickle, of which numbers and numpy arrays alone are read, not all that it holds ({text[:160]})",
                source=path,
                remedy="write its arrays with numpy.savez, or its table with to_csv or to_parquet",
            ) from error
        found: list[Recording] = []
        for label, trial in trials.items():
            arrays: dict[str, Any] = {}
            _flatten("", trial, arrays, 0)
            try:
                named = recordings_of(path.with_name(f"{path.stem}{label}"), arrays)
                found += [replace(recording, source=str(path)) for recording in named]
            except LogError:
                continue
        if not found:
            raise nothing_there(path)
        return tuple(found)


def _is_pickled_array(path: Path) -> bool:
    start = first_bytes(path, 256)
    return start.startswith(_ARRAY) and b"'descr': '|O'" in start


def gathered(value: Any, depth: int) -> Any:
    """Lists brought to arrays: of numbers, of arrays of one shape, and of dictionaries with the same entries."""
    if depth > _DEEPEST:
        return None
    if isinstance(value, np.ndarray) and value.dtype.hasobject:
        value = value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {str(key): gathered(inner, depth + 1) for key, inner in value.items()}
    if not isinstance(value, list | tuple) and not hasattr(value, "popleft"):
        return value
    items = [gathered(one, depth + 1) for one in value]
    if items and all(isinstance(one, dict) and one.keys() == items[0].keys() for one in items):
        return _by_entry(items, depth)
    if items and all(isinstance(one, int | float | str) for one in items):
        return np.array(items)
    if items and all(isinstance(one, np.ndarray) and one.shape == items[0].shape for one in items):
        return np.stack(items)
    return items


def _by_entry(items: list[dict[str, Any]], depth: int) -> Any:
    """A dictionary of what the dictionaries of a list hold; the list itself where they are trials of other lengths."""
    found = {key: gathered([one[key] for one in items], depth + 1) for key in items[0]}
    ragged = any(
        isinstance(inner, list) and inner and all(isinstance(one, np.ndarray) for one in inner)
        for inner in found.values()
    )
    return items if ragged else found


def _trials(content: Any) -> dict[str, Any]:
    """By what is put behind the file's name, each trial: the entries of a list of dictionaries, or all there is."""
    holder = content
    if isinstance(content, dict) and len(content) == 1:
        holder = next(iter(content.values()))
    if isinstance(holder, list) and holder and all(isinstance(one, dict) for one in holder):
        return {f"_{k + 1}": one for k, one in enumerate(holder)}
    return {"": content}


def _flatten(name: str, value: Any, arrays: dict[str, Any], depth: int) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(f"{name}/{key}" if name else key, inner, arrays, depth + 1)
    elif isinstance(value, np.ndarray):
        arrays[name or "data"] = value
    elif isinstance(value, int | float | str):
        arrays[name or "data"] = np.asarray(value)
