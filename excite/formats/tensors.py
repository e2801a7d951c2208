"""Tensors that torch saved: read without torch, and without running anything that the file names.

A pickle may name any function of Python and have it called. Here it may name what rebuilds a tensor, which is replaced
by a function that does nothing else, and dictionaries; whatever else it names ends the reading.
"""

from __future__ import annotations

import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from excite.formats.file import DEEPEST, MAX_NUMBERS


def _make_tensor(storage: Any, offset: int, size: Any, stride: Any, *_: Any) -> Any:
    size, stride = tuple(int(n) for n in size), tuple(int(n) for n in stride)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True) if n)
    if min((*size, *stride, offset), default=0) < 0 or (np.prod(size) and last >= len(storage)):
        raise pickle.UnpicklingError("has a tensor that reaches beyond its storage")
    if np.prod(size, dtype=float) > MAX_NUMBERS:
        raise pickle.UnpicklingError("has a tensor of more numbers than can be read")
    steps = tuple(step * storage.itemsize for step in stride)
    return np.lib.stride_tricks.as_strided(storage[offset:], size, steps).copy()


# What a file may name, and what is taken in its place: types of numbers for storages of tensors.
_KNOWN: dict[str, Any] = {
    "collections.OrderedDict": OrderedDict,
    "torch._utils._rebuild_tensor_v2": _make_tensor,
    "torch._utils._rebuild_parameter": lambda data, *_: data,
}
_STORAGES = {"Double": "<f8", "Float": "<f4", "Half": "<f2", "Long": "<i8", "Int": "<i4", "Short": "<i2"}
_KNOWN |= {
    f"torch.{kind}Storage": code for kind, code in (_STORAGES | {"Char": "<i1", "Byte": "<u1"}).items()
}
_KNOWN["torch.BoolStorage"] = "<u1"


class _TensorUnpickler(pickle.Unpickler):
    """Rebuilds dictionaries of tensors, and refuses every other name."""

    def __init__(self, stream: IO[bytes], archive: zipfile.ZipFile, folder: str) -> None:
        super().__init__(stream)
        self._archive, self._folder = archive, folder

    def find_class(self, module: str, name: str) -> Any:
        """What a file may name; raises UnpicklingError for the rest."""
        if f"{module}.{name}" not in _KNOWN:
            raise pickle.UnpicklingError(f"names {module}.{name}, which is no plain data")
        return _KNOWN[f"{module}.{name}"]

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor names, as numbers."""
        kind, dtype, key, _, count = pid
        if kind != "storage" or not isinstance(dtype, str) or not 0 <= int(count) <= MAX_NUMBERS:
            raise pickle.UnpicklingError("names a storage that cannot be read")
        return np.frombuffer(self._archive.read(f"{self._folder}data/{key}"), dtype=dtype)[: int(count)]


def read_torch(path: Path) -> dict[str, NDArray[Any]]:
    """Tensors that torch saved (PACE's ``.pt``), numbers and texts beside them, by their paths."""
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith("data.pkl")]
        if not names:
            raise ValueError("the archive holds no data.pkl")
        with archive.open(names[0]) as stream:
            content = _TensorUnpickler(stream, archive, names[0].removesuffix("data.pkl")).load()
    return _flatten_arrays("", content, 0)


def _flatten_arrays(name: str, value: Any, depth: int) -> dict[str, NDArray[Any]]:
    """Arrays within dictionaries by their paths."""
    if isinstance(value, dict) and depth <= DEEPEST:
        inner = (_flatten_arrays(f"{name}/{key}".lstrip("/"), one, depth + 1) for key, one in value.items())
        return {path: array for arrays in inner for path, array in arrays.items()}
    numbers = isinstance(value, list) and value and isinstance(value[0], int | float)
    plain = numbers or isinstance(value, np.ndarray | int | float | str)
    return {name or "data": np.asarray(value)} if plain else {}
