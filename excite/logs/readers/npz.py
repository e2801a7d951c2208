"""Trials in numpy archives: one array a column."""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, ClassVar, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.readers.reader import TrialReader, check_size, no_numbers, unreadable

# What zipfile, zlib and numpy raise of damaged archives.
_DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    RuntimeError,
    MemoryError,
    OverflowError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
    TokenError,
    SyntaxError,
)
# What numpy writes; others take more memory to open than they save here.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_HEADERS: dict[tuple[int, int], Any] = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_ENDING = ".npy"


class NpzReader(TrialReader):
    """A numpy archive, one array a channel."""

    name: ClassVar[str] = "npz"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def _columns(self, path: Path) -> dict[str, Array]:
        try:
            with zipfile.ZipFile(path) as archive:
                members = archive.infolist()
                _check_members(members, path)
                return {
                    item.filename.removesuffix(_ENDING): _read_array(archive, item, path) for item in members
                }
        except _DAMAGED as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        np.savez_compressed(path, allow_pickle=False, **columns)


def _check_members(members: list[zipfile.ZipInfo], path: Path) -> None:
    """Refuse archives by what their table of contents says; raises LogError."""
    check_size(sum(item.file_size for item in members) // 8, len(members), path)
    twice = [name for name, count in Counter(item.filename for item in members).items() if count > 1]
    if twice:
        raise LogError("stands twice", source=path, field=twice[0][:60], remedy="keep one of the arrays")
    for item in members:
        if not item.filename.endswith(_ENDING):
            raise LogError(
                "is no array",
                source=path,
                field=item.filename[:60],
                remedy="keep arrays alone in the archive",
            )
        if item.compress_type not in _METHODS or item.flag_bits & 1:
            raise LogError(
                "is packed in a way that numpy does not use",
                source=path,
                field=item.filename[:60],
                remedy="save it with numpy.savez_compressed",
            )


def _read_array(archive: zipfile.ZipFile, item: zipfile.ZipInfo, path: Path) -> NDArray[Any]:
    """One array, no larger than its member says; raises LogError or one of ``_DAMAGED``."""
    with archive.open(item) as stream:
        shape, fortran, dtype = _read_header(stream)
        if dtype.hasobject:
            raise LogError(
                "is not numeric but pickled Python objects",
                source=path,
                field=item.filename.removesuffix(_ENDING)[:60],
                remedy="save numbers only: numpy.savez(file, time=…, **{'q.JOINT': …})",
            )
        if dtype.kind not in "fiu" or len(shape) not in {1, 2}:
            return no_numbers(dtype)
        size = math.prod(shape) * dtype.itemsize
        if size > item.file_size:
            raise LogError(
                f"says that it has shape {shape}, more than the file holds",
                source=path,
                field=item.filename.removesuffix(_ENDING)[:60],
                remedy="check that the file is complete",
            )
        # To the end, where the check sum is looked at.
        data = stream.read()
    if len(data) != size:
        raise EOFError(f"{item.filename[:60]} has {len(data)} bytes, not {size}")
    values = np.frombuffer(data, dtype)
    return values.reshape(shape, order="F" if fortran else "C")


class _Header(NamedTuple):
    """What an array's member says of it."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]


def _read_header(stream: IO[bytes]) -> _Header:
    version = npy.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"format {version} of arrays")
    shape, fortran, dtype = _HEADERS[version](stream)
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {shape}")
    return _Header(shape, fortran, dtype)
