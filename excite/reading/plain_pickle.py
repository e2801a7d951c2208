"""Pickles of plain data: numbers, texts, numpy arrays and containers of them; nothing that runs is ever named.

A pickle may name any function of Python and have it called. Here it may name the few that numpy's arrays are rebuilt
with, replaced by ones that do nothing else, and containers; whatever else it names ends the reading.
"""

from __future__ import annotations

import pickle
from collections import OrderedDict, defaultdict, deque
from typing import IO, Any

import numpy as np

# What damaged or foreign pickles end with.
PICKLE_FAULTS = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    EOFError,
    AttributeError,
    RecursionError,
    MemoryError,
    OverflowError,
    UnicodeError,
    ImportError,
    pickle.UnpicklingError,
)
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
