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


def _check_dtype(dtype: Any) -> np.dtype[Any]:
    if not isinstance(dtype, np.dtype) or dtype.hasobject:
        raise pickle.UnpicklingError("has numbers of a type that no recording has")
    return dtype


def _numpy_dtype(code: Any, *_: Any) -> Any:
    if not isinstance(code, str):
        raise pickle.UnpicklingError("names a type of numbers that no recording has")
    return np.dtype(code)


def _numpy_scalar(dtype: Any, content: Any = b"") -> Any:
    raw = content.encode("latin1") if isinstance(content, str) else bytes(content)
    return np.frombuffer(raw, _check_dtype(dtype), count=1)[0]


def _from_buffer(content: Any, dtype: Any, shape: Any, order: Any, *_: Any) -> Any:
    return np.frombuffer(bytes(content), _check_dtype(dtype)).reshape(shape, order=order)


def _tensor(storage: Any, offset: int, size: Any, stride: Any, *_: Any) -> Any:
    size, stride = tuple(int(n) for n in size), tuple(int(n) for n in stride)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True) if n)
    if min((*size, *stride, offset), default=0) < 0 or (np.prod(size) and last >= len(storage)):
        raise pickle.UnpicklingError("has a tensor that reaches beyond its storage")
    if np.prod(size, dtype=float) > MAX_NUMBERS:
        raise pickle.UnpicklingError("has a tensor of more numbers than can be read")
    steps = tuple(step * storage.itemsize for step in stride)
    return np.lib.stride_tricks.as_strided(storage[offset:], size, steps).copy()


# What a pickle may name, and what is called in its place.
_PLAIN: dict[str, Any] = {
    **{f"collections.{kind.__name__}": kind for kind in (OrderedDict, defaultdict, deque)},
    **{f"builtins.{kind.__name__}": kind for kind in (list, dict, tuple, set, frozenset, complex, bytearray)},
    "numpy.ndarray": np.ndarray,
    "numpy.dtype": _numpy_dtype,
    # The array that numpy's state is then put into.
    "numpy.core.multiarray._reconstruct": lambda *_: np.ndarray((0,), dtype="b"),
    "numpy.core.multiarray.scalar": _numpy_scalar,
    "numpy.core.numeric._frombuffer": _from_buffer,
    "_codecs.encode": lambda text, *_: str(text).encode("latin1"),
}
# Beside it, what builds a tensor of torch from its storage.
_TENSORS: dict[str, Any] = {
    "torch.DoubleStorage": "<f8",
    "torch.FloatStorage": "<f4",
    "torch.HalfStorage": "<f2",
    "torch.LongStorage": "<i8",
    "torch.IntStorage": "<i4",
    "torch.ShortStorage": "<i2",
    "torch.CharStorage": "<i1",
    "torch.ByteStorage": "<u1",
    "torch.BoolStorage": "<u1",
    "torch._utils._rebuild_tensor_v2": _tensor,
    "torch._utils._rebuild_parameter": lambda data, *_: data,
}


class _PlainUnpickler(pickle.Unpickler):
    """Rebuilds plain data and refuses every other name; with an archive of torch, tensors too."""

    def __init__(self, stream: IO[bytes], archive: zipfile.ZipFile | None = None, folder: str = "") -> None:
        # Texts of Python 2 are bytes; arrays of its time are among them.
        super().__init__(stream, encoding="latin1")
        self._archive, self._folder = archive, folder
        self._known = _PLAIN if archive is None else _PLAIN | _TENSORS

    def find_class(self, module: str, name: str) -> Any:
        """What a pickle may name; raises UnpicklingError for the rest."""
        module = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        if f"{module}.{name}" not in self._known:
            raise pickle.UnpicklingError(f"names {module}.{name}, which is no plain data")
        return self._known[f"{module}.{name}"]

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor names, as numbers."""
        kind, dtype, key, _, count = pid
        if kind != "storage" or not isinstance(dtype, str) or not 0 <= int(count) <= MAX_NUMBERS:
            raise pickle.UnpicklingError("names a storage that cannot be read")
        if self._archive is None:
            raise pickle.UnpicklingError("names a storage beside it")
        return np.frombuffer(self._archive.read(f"{self._folder}data/{key}"), dtype=dtype)[: int(count)]


def is_pickled_array(path: Path) -> bool:
    """Whether a ``.npy`` holds Python's objects."""
    start = first_bytes(path, 256)
    return start.startswith(_ARRAY) and b"'descr': '|O'" in start


def read_pickle(path: Path) -> dict[str, Any]:
    """Trials of a pickle, or of an array of objects: by what distinguishes each, empty where there is one alone."""
    with path.open("rb") as stream:
        if first_bytes(path, len(_ARRAY)) == _ARRAY:
            npy_header(stream)
        content = _PlainUnpickler(stream).load()
    return _trials(_gather(content, 0))


def _gather(value: Any, depth: int) -> Any:
    """Lists brought to arrays: of numbers, of arrays of one shape, and of dictionaries with the same entries."""
    if depth > _DEEPEST:
        return None
    if isinstance(value, np.ndarray) and value.dtype.hasobject:
        value = value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {str(key): _gather(inner, depth + 1) for key, inner in value.items()}
    if not isinstance(value, list | tuple) and not hasattr(value, "popleft"):
        return value
    items = [_gather(one, depth + 1) for one in value]
    if items and all(isinstance(one, dict) and one.keys() == items[0].keys() for one in items):
        return _by_entry(items, depth)
    if items and all(isinstance(one, int | float | str) for one in items):
        return np.array(items)
    if items and all(isinstance(one, np.ndarray) and one.shape == items[0].shape for one in items):
        return np.stack(items)
    return items


def _by_entry(items: list[dict[str, Any]], depth: int) -> Any:
    """A dictionary of what the dictionaries of a list hold; the list itself where they are trials of other lengths."""
    found = {key: _gather([one[key] for one in items], depth + 1) for key in items[0]}
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


def read_torch(path: Path) -> dict[str, NDArray[Any]]:
    """Tensors that torch saved (PACE's ``.pt``) and numbers beside them by their paths, read without torch."""
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith("data.pkl")]
        if not names:
            raise ValueError("the archive holds no data.pkl")
        with archive.open(names[0]) as stream:
            content = _PlainUnpickler(stream, archive, names[0].removesuffix("data.pkl")).load()
    return flatten_arrays(content)
