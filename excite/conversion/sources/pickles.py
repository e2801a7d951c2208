"""Pickles of plain data and recordings saved by torch, read without running anything in them."""

from __future__ import annotations

import pickle
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, stream_of_arrays
from excite.conversion.sources.npz import constants, recordings_of
from excite.conversion.sources.source import MAX_NUMBERS, Source, damaged
from excite.errors import LogError
from excite.formats.arrays import PlainUnpickler
from excite.formats.file import DAMAGED, check_file, first_bytes

# Pickles of plain data (``.pkl``), and arrays in which numpy pickled a dictionary: read without running
# anything.

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
        except DAMAGED as error:
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


# Recordings that torch saved (PACE's ``.pt``), read without torch: only tensors of numbers in plain
# containers.
#
# Of what a pickle may name, here are the few that build a tensor from its storage, beside plain data.

_TYPES = {
    "DoubleStorage": "<f8",
    "FloatStorage": "<f4",
    "HalfStorage": "<f2",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "ShortStorage": "<i2",
    "CharStorage": "<i1",
    "ByteStorage": "<u1",
    "BoolStorage": "<u1",
}
_PACE_MAX_BYTES = 2_000_000_000


class PaceSource(Source):
    """A dictionary of tensors."""

    name: ClassVar[str] = "pace"
    summary: ClassVar[str] = "tensors saved by torch (.pt, .pth), as PACE writes them"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and path.suffix.lower() in {".pt", ".pth"} and first_bytes(path, 2) == b"PK"

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_PACE_MAX_BYTES, error=LogError)
        try:
            content = _load(path)
        except (*DAMAGED, zipfile.BadZipFile) as error:
            raise damaged(path, error, "tensors of torch") from error
        arrays: dict[str, Any] = {}
        _collect("", content, arrays, 0)
        streams = longest_streams(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams, constants(arrays)),)


def _load(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith("data.pkl")]
        if not names:
            raise ValueError("the archive holds no data.pkl")
        with archive.open(names[0]) as stream:
            return _Unpickler(stream, archive, names[0].removesuffix("data.pkl")).load()


class _Unpickler(PlainUnpickler):
    """Builds tensors as numpy arrays; refuses every name that is none and no plain data."""

    def __init__(self, stream: IO[bytes], archive: zipfile.ZipFile, folder: str) -> None:
        super().__init__(stream)
        self._archive, self._folder = archive, folder

    def find_class(self, module: str, name: str) -> Any:
        """See :class:`PlainUnpickler`: tensors besides."""
        if module == "torch" and name in _TYPES:
            return _TYPES[name]
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return _parameter
        return super().find_class(module, name)

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor names, as numbers."""
        kind, dtype, key, _, count = pid
        if kind != "storage" or not isinstance(dtype, str) or not 0 <= int(count) <= MAX_NUMBERS:
            raise pickle.UnpicklingError("names a storage that cannot be read")
        raw = self._archive.read(f"{self._folder}data/{key}")
        return np.frombuffer(raw, dtype=dtype)[: int(count)]


def _tensor(storage: Any, offset: int, size: Any, stride: Any, *_: Any) -> Any:
    size, stride = tuple(int(n) for n in size), tuple(int(n) for n in stride)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True) if n)
    if min((*size, *stride, offset), default=0) < 0 or (np.prod(size) and last >= len(storage)):
        raise pickle.UnpicklingError("has a tensor that reaches beyond its storage")
    if np.prod(size, dtype=float) > MAX_NUMBERS:
        raise pickle.UnpicklingError("has a tensor of more numbers than can be read")
    steps = tuple(step * storage.itemsize for step in stride)
    return np.lib.stride_tricks.as_strided(storage[offset:], size, steps).copy()


def _parameter(data: Any, *_: Any) -> Any:
    return data


def _collect(name: str, value: Any, arrays: dict[str, Any], depth: int) -> None:
    if isinstance(value, dict) and depth < 8:
        for key, inner in value.items():
            _collect(f"{name}/{key}" if name else str(key), inner, arrays, depth + 1)
    elif isinstance(value, np.ndarray):
        arrays[name] = value
    elif isinstance(value, int | float):
        arrays[name] = np.asarray(value)
    elif isinstance(value, list) and value and isinstance(value[0], int | float):
        arrays[name] = np.asarray(value, dtype=float)
