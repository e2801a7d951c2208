"""Recordings that torch saved (PACE's ``.pt``), read without torch: only tensors of numbers in plain containers.

Of what a pickle may name, here are the few that build a tensor from its storage, beside plain data.
"""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes.array_streams import longest_streams, stream_of_arrays
from excite.conversion.sources.npz import constants
from excite.conversion.sources.source import MAX_NUMBERS, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes
from excite.reading.plain_pickle import PICKLE_FAULTS, PlainUnpickler

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
_MAX_BYTES = 2_000_000_000


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
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            content = _load(path)
        except (*PICKLE_FAULTS, zipfile.BadZipFile) as error:
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
