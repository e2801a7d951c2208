"""NumPy's archives and arrays, npz and npy: what each declares is checked before its values are read."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from pathlib import Path
from typing import IO, Any, ClassVar, NamedTuple
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from excite.errors import InputError, in_one_line
from excite.formats.file import (
    DAMAGED,
    MAX_FILE_BYTES,
    MAX_NUMBERS,
    MAX_TEXT_BYTES,
    check_file,
    check_size,
    unreadable,
)
from excite.formats.format import ColumnFormat, Content

# Names that a text array holds are names of files, joints and units.
_LONGEST_TEXT = 255
_KINDS = "fiubU"
# What numpy writes; others take more memory to open than they save here.
_METHODS = (ZIP_STORED, ZIP_DEFLATED)
# How a statement is called among arrays.
STATEMENT = "__metadata__"
_NUMBERS_ONLY = "write its arrays one by one, numbers only: numpy.savez(file, q=…, tau=…)"


class NpzFormat(ColumnFormat):
    """A numpy archive, one array a channel."""

    name: ClassVar[str] = "npz"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def _read(self, path: Path) -> Content:
        found = read_npz(
            path,
            limit=8 * MAX_NUMBERS,
            longest_text=1_000_000,
            others_empty=True,
            remedy="check that the file is complete",
        )
        # Written by numpy for its own option of that name.
        found.pop("allow_pickle", None)
        statement = found.pop(STATEMENT, None)
        return Content(found, "" if statement is None else str(statement))

    def write(self, columns: Mapping[str, NDArray[Any]], path: Path, statement: str = "") -> None:
        """See :meth:`ColumnFormat.write`."""
        said = {STATEMENT: np.array(statement)} if statement else {}
        np.savez_compressed(path, allow_pickle=False, **said, **columns)


def read_npz(
    path: str | Path,
    known: Container[str] | None = None,
    *,
    limit: int = MAX_TEXT_BYTES,
    longest_text: int = _LONGEST_TEXT,
    others_empty: bool = False,
    remedy: str = "write it again",
) -> dict[str, NDArray[Any]]:
    """Arrays of an npz archive by name, numbers, flags and short texts, each checked before its values are read.

    Args:
        known: names of arrays that may be in it; None for any.
        limit: most bytes of the file, and of all its arrays together.
        longest_text: most characters of a text.
        others_empty: whether arrays of other kinds come without rows; else they are refused, as pickles always are.
        remedy: what to do where it is wrong.

    Raises:
        InputError: no such file, no archive, damaged, an array that is not known, stands twice,
            is of another kind, or is larger than allowed or than it declares.
    """
    path = check_file(path, limit=limit)
    arrays: dict[str, NDArray[Any]] = {}
    left = limit
    name: str | None = None
    try:
        with ZipFile(path) as archive:
            members = archive.infolist()
            check_size(sum(member.file_size for member in members) // 8, len(members), path)
            for member in members:
                name = member.filename.removesuffix(".npy")
                with _known_member(archive, member, name, known, arrays, left) as stream:
                    arrays[name] = _read_member(stream, member, longest_text, others_empty=others_empty)
                left -= member.file_size
    except _Refused as reason:
        raise InputError(str(reason), source=path, field=(name or "")[:60] or None, remedy=remedy) from None
    except DAMAGED as reason:
        raise InputError(
            f"cannot be read ({in_one_line(reason)[:160]})",
            source=path,
            field=(name or "")[:60] or None,
            remedy=remedy,
        ) from reason
    return arrays


class _Refused(Exception):
    """What is wrong with a member of an archive."""


def _known_member(
    archive: ZipFile,
    member: ZipInfo,
    name: str,
    known: Container[str] | None,
    taken: Container[str],
    left: int,
) -> IO[bytes]:
    """A member that belongs there, opened; raises what is wrong with its name, size or packing."""
    if name == member.filename or (known is not None and name not in known):
        raise _Refused("is no array that belongs here")
    if name in taken:
        raise _Refused("stands twice")
    if member.file_size > left:
        raise _Refused(f"declares {member.file_size} bytes, more than the {left} that are read")
    if member.compress_type not in _METHODS or member.flag_bits & 1:
        raise _Refused("is packed in a way that numpy does not use")
    return archive.open(member)


def _read_member(
    stream: IO[bytes], member: ZipInfo, longest_text: int, *, others_empty: bool
) -> NDArray[Any]:
    """The array of a member; raises what is wrong with its kind or shape before its values are read."""
    shape, fortran, dtype = npy_header(stream)
    if others_empty and dtype.hasobject:
        raise _Refused("is not numeric but pickled Python objects")
    if dtype.kind not in _KINDS or dtype.itemsize > 4 * longest_text:
        if others_empty:
            return np.empty(0, dtype)
        raise _Refused(f"holds {str(dtype)[:60]}, not numbers, flags or short texts")
    content = member.file_size - stream.tell()
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != content:
        raise _Refused(f"declares the shape {shape}, and holds {content} bytes")
    # To the end, where the check sum is looked at.
    return np.frombuffer(bytearray(stream.read()), dtype).reshape(shape, order="F" if fortran else "C")


class NpyHeader(NamedTuple):
    """What an array's file says of it."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]


def npy_header(stream: IO[bytes]) -> NpyHeader:
    """The header of an array's file, of which the values follow."""
    version = npy.read_magic(stream)
    header: Any = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    return NpyHeader(*header(stream))


def read_npy(path: Path) -> dict[str, NDArray[Any]]:
    """The array of a ``.npy`` under the file's name, or its fields under theirs; raises InputError."""
    check_file(path, limit=MAX_FILE_BYTES)
    with unreadable(path, "a numpy array"):
        with path.open("rb") as stream:
            if npy_header(stream).dtype.hasobject:
                text = "holds pickled Python objects, which are not opened"
                raise InputError(text, source=path, remedy=_NUMBERS_ONLY)
        # Mapped, so that a shape beyond the file's end is refused before memory is asked for.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names:
        return {name: np.asarray(array[name]) for name in array.dtype.names}
    return {path.stem: np.asarray(array)}
