"""npz archives and pickles of plain data, checked before their values are read."""

from __future__ import annotations

import lzma
import math
import pickle
import tokenize
import zlib
from collections import OrderedDict, defaultdict, deque
from collections.abc import Container
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from excite.errors import InputError
from excite.reading.file import check_file

# npz archives as arrays: what a member declares is checked before its values are read.

# Ten minutes of sixty channels, thrice, at 200 samples a second are 170 MB.
MAX_NPZ_BYTES = 256 * 1024 * 1024
# Names that a text array holds are names of files, joints and units.
_LONGEST_TEXT = 255
_KINDS = "fiubU"
# What zipfile, its decompressors and numpy's reader of headers raise for files that are damaged or lie.
_DAMAGED = (
    *(OSError, ValueError, EOFError, BadZipFile, zlib.error, lzma.LZMAError),
    *(
        NotImplementedError,
        RuntimeError,
        RecursionError,
        MemoryError,
        SyntaxError,
        tokenize.TokenError,
        TypeError,
        KeyError,
    ),
)


def read_npz(
    path: str | Path,
    known: Container[str] | None = None,
    *,
    limit: int = MAX_NPZ_BYTES,
    longest_text: int = _LONGEST_TEXT,
    remedy: str = "write it again",
    error: type[InputError] = InputError,
) -> dict[str, NDArray[Any]]:
    """Arrays of an npz archive by name: numbers, flags and short texts.

    Args:
        path: of the archive.
        known: names of arrays that may be in it; None for any.
        limit: most bytes of the file, and of all its arrays together.
        longest_text: most characters of a text.
        remedy: what to do where it is wrong.
        error: class of the errors.

    Raises:
        InputError: of the class ``error``: no such file, no archive, damaged, an array that is not known, stands twice,
            is of another kind, or is larger than allowed or than it declares.
    """
    path = check_file(path, limit=limit, error=error)
    arrays: dict[str, NDArray[Any]] = {}
    left = limit
    name: str | None = None
    try:
        with ZipFile(path) as archive:
            for member in archive.infolist():
                name = member.filename.removesuffix(".npy")
                said = _not_wanted(member, name, known, arrays, left) or _member_fault(
                    archive, member, longest_text
                )
                if said is not None:
                    raise error(said, source=path, field=name[:60], remedy=remedy)
                left -= member.file_size
                with archive.open(member) as stream:
                    arrays[name] = npy.read_array(stream, allow_pickle=False)
    except _DAMAGED as reason:
        line = " ".join(str(reason).split())[:160] or type(reason).__name__
        raise error(
            f"cannot be read ({line})", source=path, field=None if name is None else name[:60], remedy=remedy
        ) from reason
    return arrays


def _not_wanted(
    member: ZipInfo, name: str, known: Container[str] | None, taken: Container[str], left: int
) -> str | None:
    """What speaks against a member by its name and size; None where nothing does."""
    if name == member.filename or (known is not None and name not in known):
        return "is no array that belongs here"
    if name in taken:
        return "stands twice"
    if member.file_size > left:
        return f"declares {member.file_size} bytes, more than the {left} that are read"
    return None


def _member_fault(archive: ZipFile, member: ZipInfo, longest_text: int) -> str | None:
    """What is wrong with a member before its values are read; None where nothing is."""
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        header: Any = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = header(stream)
        content = member.file_size - stream.tell()
    if dtype.kind not in _KINDS or dtype.itemsize > 4 * longest_text:
        return f"holds {str(dtype)[:60]}, not numbers, flags or short texts"
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != content:
        return f"declares the shape {shape}, and holds {content} bytes"
    return None


# Pickles of plain data: numbers, texts, numpy arrays and containers of them; nothing that runs is ever named.
#
# A pickle may name any function of Python and have it called. Here it may name the few that numpy's arrays
# are rebuilt with, replaced by ones that do nothing else, and containers; whatever else it names ends the
# reading.

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
