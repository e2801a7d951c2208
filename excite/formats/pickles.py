"""Pickles of plain data, and tensors that torch saved: read without running anything that they name.

A pickle may name any function of Python and have it called. Here it may name the few that numpy's arrays are rebuilt
with, replaced by ones that do nothing else, and containers; whatever else it names ends the reading.
"""

from __future__ import annotations

import pickle
import zipfile
from collections import OrderedDict, defaultdict, deque
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from excite.formats.arrays import npy_header
from excite.formats.file import MAX_NUMBERS, first_bytes

_DEEPEST = 8
_ARRAY = b"\x93NUMPY"
_CONTAINERS = {
    ("collections", "OrderedDict"): OrderedDict,
    ("collections", "defaultdict"): defaultdict,
    ("collections", "deque"): deque,
    ("builtins", "list"): list,
    ("builtins", "dict"): dict,
    ("builtins", "tuple"): tuple,
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "complex"): complex,
    ("builtins", "bytearray"): bytearray,
    ("numpy", "ndarray"): np.ndarray,
}


class PlainUnpickler(pickle.Unpickler):
    """Rebuilds plain data and refuses every other name."""

    def __init__(self, stream: IO[bytes]) -> None:
        # Texts of Python 2 are bytes; arrays of its time are among them.
        super().__init__(stream, encoding="latin1")

    def find_class(self, module: str, name: str) -> Any:
        """What a pickle may name; raises UnpicklingError for the rest."""
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if (module, name) in _CONTAINERS:
            return _CONTAINERS[module, name]
        if (module, name) == ("numpy.core.multiarray", "_reconstruct"):
            return _empty_array
        if (module, name) == ("numpy.core.multiarray", "scalar"):
            return _numpy_scalar
        if (module, name) == ("numpy.core.numeric", "_frombuffer"):
            return _from_buffer
        if (module, name) == ("numpy", "dtype"):
            return _numpy_dtype
        if (module, name) == ("_codecs", "encode"):
            return _latin_bytes
        raise pickle.UnpicklingError(f"names {module}.{name}, which is no plain data")


def _empty_array(*_: Any) -> Any:
    """The array that numpy's state is then put into."""
    return np.ndarray((0,), dtype="b")


def _numpy_dtype(code: Any, *_: Any) -> Any:
    if not isinstance(code, str):
        raise pickle.UnpicklingError("names a type of numbers that no recording has")
    return np.dtype(code)


def _numpy_scalar(dtype: Any, content: Any = b"") -> Any:
    if not isinstance(dtype, np.dtype) or dtype.hasobject:
        raise pickle.UnpicklingError("has a number of a type that no recording has")
    raw = content.encode("latin1") if isinstance(content, str) else bytes(content)
    return np.frombuffer(raw, dtype=dtype, count=1)[0]


def _from_buffer(content: Any, dtype: Any, shape: Any, order: Any, *_: Any) -> Any:
    if not isinstance(dtype, np.dtype) or dtype.hasobject:
        raise pickle.UnpicklingError("has numbers of a type that no recording has")
    return np.frombuffer(bytes(content), dtype=dtype).reshape(shape, order=order)


def _latin_bytes(text: Any, *_: Any) -> bytes:
    return str(text).encode("latin1")


def is_pickled_array(path: Path) -> bool:
    """Whether a ``.npy`` holds Python's objects."""
    start = first_bytes(path, 256)
    return start.startswith(_ARRAY) and b"'descr': '|O'" in start


def read_pickle(path: Path) -> dict[str, Any]:
    """Trials of a pickle, or of an array of objects: by what distinguishes each, empty where there is one alone."""
    with path.open("rb") as stream:
        if first_bytes(path, len(_ARRAY)) == _ARRAY:
            npy_header(stream)
        content = PlainUnpickler(stream).load()
    return _trials(gathered(content, 0))


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


def flatten_arrays(content: Any) -> dict[str, NDArray[Any]]:
    """Arrays, numbers and texts within dictionaries, by their paths."""
    found: dict[str, NDArray[Any]] = {}
    _flatten("", content, found, 0)
    return found


def _flatten(name: str, value: Any, arrays: dict[str, NDArray[Any]], depth: int) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(f"{name}/{key}" if name else key, inner, arrays, depth + 1)
    elif isinstance(value, np.ndarray):
        arrays[name or "data"] = value
    elif isinstance(value, int | float | str):
        arrays[name or "data"] = np.asarray(value)
    elif isinstance(value, list) and value and isinstance(value[0], int | float):
        arrays[name or "data"] = np.asarray(value, dtype=float)


# Of what a pickle of torch may name, here are the few that build a tensor from its storage, beside plain data.

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


def read_torch(path: Path) -> dict[str, NDArray[Any]]:
    """Tensors that torch saved (PACE's ``.pt``) and numbers beside them by their paths, read without torch."""
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith("data.pkl")]
        if not names:
            raise ValueError("the archive holds no data.pkl")
        with archive.open(names[0]) as stream:
            content = _TorchUnpickler(stream, archive, names[0].removesuffix("data.pkl")).load()
    return flatten_arrays(content)


class _TorchUnpickler(PlainUnpickler):
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
