"""Readers of trial files, one a format."""

from __future__ import annotations

import importlib.util
import math
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tokenize import TokenError
from typing import IO, TYPE_CHECKING, Any, BinaryIO, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.lib import format as npy
from numpy.typing import NDArray

from excite.arrays import Array
from excite.arrow_columns import arrow_table, numpy_columns, open_parquet, read_numbers
from excite.errors import LogError
from excite.reading.child import in_child
from excite.reading.file import check_file, is_packed, pack_file, plain_name, unpack_file
from excite.temporary_folder import TemporaryFolder

if TYPE_CHECKING:
    import h5py

# What every format of trial files offers: named columns of numbers, read and written.

# An hour at 1 kHz of an arm with 55 channels: 1.6 GB as numbers, of which a few copies fit into a usual memory.
MAX_NUMBERS = 200_000_000
# A humanoid with hands has 500 columns, an array of tactile sensors some thousand.
MAX_COLUMNS = 20_000
# Ten bytes a number, as text has them.
MAX_TRIAL_BYTES = 10 * MAX_NUMBERS


class TrialReader(ABC):
    """A file format for trials.

    Attributes:
        name: name of the format.
        suffixes: file name endings that it answers to, lower case, with the dot.
        own_process: function that reads a list of files in a process of its own, ``package.module:name``, for formats
            whose library damaged files make crash or hang; None for the others.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    own_process: ClassVar[str | None] = None

    def read(self, path: Path) -> dict[str, Array]:
        """Read all columns, ``(n,)`` each, as they stand in the file; those that hold no numbers come empty.

        Raises:
            LogError: the file is missing, is no such file, or holds more than can be read.
        """
        return self._columns(check_file(path, limit=MAX_TRIAL_BYTES, error=LogError))

    @abstractmethod
    def _columns(self, path: Path) -> dict[str, Array]:
        """What :meth:`read` returns, of a regular file of bounded size."""

    @abstractmethod
    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """Write columns, ``(n,)`` each, to ``path``."""


def check_size(numbers: int, columns: int, path: Path) -> None:
    """Refuse a file by what it says that it holds, before any of it is read; raises LogError."""
    if columns > MAX_COLUMNS:
        raise LogError(
            f"has {columns} columns, more than the {MAX_COLUMNS} that are read",
            source=path,
            remedy="leave out what is no channel of the robot",
        )
    if numbers > MAX_NUMBERS:
        raise LogError(
            f"holds {numbers} numbers, more than the {MAX_NUMBERS} that are read",
            source=path,
            remedy="split the recording",
        )


def no_numbers(dtype: np.dtype[Any]) -> NDArray[Any]:
    """What stands for a column that holds words, dates or anything else that is no number: its type, no rows."""
    return np.empty(0, dtype)


def unreadable(path: Path, error: Exception) -> LogError:
    """The error for a file that its library cannot read, in one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(f"cannot be read ({text[:160]})", source=path, remedy="check that the file is complete")


# Trials in HDF5 files: one dataset a column.


class Hdf5Reader(TrialReader):
    """HDF5, one dataset a channel at the root; needs the package ``h5py``.

    The library trusts much of what a file says, so that it runs in a process of its own.
    """

    name: ClassVar[str] = "hdf5"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    own_process: ClassVar[str | None] = f"{__name__}:read_hdf5"

    def _columns(self, path: Path) -> dict[str, Array]:
        _require_h5py(path)
        import h5py

        try:
            with h5py.File(path, "r") as file:
                datasets = _root_datasets(file, path)
                sizes = [math.prod(item.shape) for item in datasets.values() if _is_readable(item)]
                check_size(sum(sizes), len(datasets), path)
                return {name: _read_dataset(item) for name, item in datasets.items()}
        # What h5py raises of damaged files.
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, AttributeError) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        _require_h5py(path)
        import h5py

        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip", fletcher32=True)


def read_hdf5(paths: list[Path]) -> list[dict[str, Array]]:
    """Columns of files, read in this process."""
    return [Hdf5Reader().read(path) for path in paths]


def _root_datasets(file: h5py.File, path: Path) -> dict[str, h5py.Dataset]:
    """Datasets at the root that hold their data themselves; raises LogError for those that lie elsewhere."""
    import h5py

    check_size(0, len(file), path)
    found = {}
    for name in file:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            raise LogError(
                "is a link", source=path, field=name[:60], remedy="store the numbers in the file itself"
            )
        item = file[name]
        if not isinstance(item, h5py.Dataset):
            continue
        if item.is_virtual or item.external:
            raise LogError(
                "lies in another file",
                source=path,
                field=name[:60],
                remedy="store the numbers in the file itself",
            )
        found[name] = item
    return found


def _is_readable(item: h5py.Dataset) -> bool:
    return item.dtype.kind in "fiu" and len(item.shape or ()) in {1, 2}


def _read_dataset(item: h5py.Dataset) -> NDArray[Any]:
    return np.asarray(item[()]) if _is_readable(item) else no_numbers(item.dtype)


def _require_h5py(path: Path) -> None:
    if importlib.util.find_spec("h5py") is None:
        raise LogError(
            "HDF5 needs the package h5py", source=path, remedy="pip install h5py, or use .parquet, .csv, .npz"
        )


# Trials in comma-separated text with one line of names.

# The longest line of names or of comments: as many columns as are read, of fifty letters each [bytes].
_LONGEST_LINE = 50 * MAX_COLUMNS
_MOST_COMMENTS = 1000


class CsvReader(TrialReader):
    """Comma-separated values, names in the first line, ``#`` lines before it left out."""

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def _columns(self, path: Path) -> dict[str, Array]:
        try:
            with path.open("rb") as stream:
                stream.seek(_names_line_start(stream, path))
                table = pa.csv.read_csv(stream)
            names = [name.strip() for name in table.column_names]
        except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise LogError("stands twice", source=path, field=twice[0][:60], remedy="keep one of the columns")
        check_size(table.num_rows * len(names), len(names), path)
        try:
            return numpy_columns(table.rename_columns(names))
        except (ValueError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        pa.csv.write_csv(arrow_table(columns), path, write_options=pa.csv.WriteOptions(quoting_style="none"))


def _names_line_start(stream: BinaryIO, path: Path) -> int:
    """Where the line of names begins, which has to be one; raises LogError."""
    for _ in range(_MOST_COMMENTS):
        start = stream.tell()
        line = stream.readline(_LONGEST_LINE + 1)
        if len(line) > _LONGEST_LINE:
            raise LogError(
                f"has a line of more than {_LONGEST_LINE} bytes where the columns' names should stand",
                source=path,
                remedy="check that it is the right file",
            )
        if not line.startswith(b"#"):
            check_size(0, line.count(b",") + 1, path)
            return start
    raise LogError(
        f"begins with more than {_MOST_COMMENTS} lines of comments",
        source=path,
        remedy="check that it is the right file",
    )


# Trials in numpy archives: one array a column.

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


# Trials in Apache Parquet: one table, a column a channel.

# Numbers that are laid out for writing at once, 80 MB: a long recording is not held a second time for it.
_GROUP = 10_000_000


class ParquetReader(TrialReader):
    """Apache Parquet, one column a channel."""

    name: ClassVar[str] = "parquet"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)

    def _columns(self, path: Path) -> dict[str, Array]:
        try:
            with open_parquet(path) as file:
                rows, columns = file.metadata.num_rows, file.metadata.num_columns
                check_size(rows * columns, columns, path)
                return read_numbers(file)
        except (OSError, ValueError, KeyError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        length = max((len(column) for column in columns.values()), default=0)
        rows = max(1, _GROUP // max(len(columns), 1))
        schema = arrow_table({name: column[:0] for name, column in columns.items()}).schema
        with pa.parquet.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True) as file:
            for start in range(0, max(length, 1), rows):
                part = {name: column[start : start + rows] for name, column in columns.items()}
                file.write_table(arrow_table(part))


# The formats of trial files that are known, by name. A new one is one file beside this one and its line here.

# A process starts in less than a second; the rest is for the file, at a tenth of what disks and gzip do [s, bytes/s].
_STARTING_S, _BYTES_PER_S = 20.0, 5e6

READERS: dict[str, type[TrialReader]] = {
    reader.name: reader
    for reader in (
        ParquetReader,
        CsvReader,
        NpzReader,
        Hdf5Reader,
    )
}


def reader_for(path: Path) -> TrialReader:
    """The reader of a file by its suffix.

    Raises:
        LogError: no format has that suffix.
    """
    for reader in READERS.values():
        if plain_name(path).suffix.lower() in reader.suffixes:
            return reader()
    known = ", ".join(suffix for reader in READERS.values() for suffix in reader.suffixes)
    raise LogError(f"unknown format {path.suffix[:60]!r}", source=path, remedy=f"use one of {known}")


def read_trial(path: Path) -> dict[str, Array]:
    """Columns of one file; see :func:`read_trials`."""
    return next(read_trials([path]))


def read_trials(paths: Sequence[Path]) -> Iterator[dict[str, Array]]:
    """Columns of trial files by their suffixes, one file after the other.

    Files of libraries that may crash are read in one process for all of them: starting it takes longer than reading.

    Raises:
        LogError: no format has a suffix; a file is missing, is no such file, or holds more than can be read.
    """
    readers = [reader_for(path) for path in paths]
    found: dict[Path, dict[str, Array]] = {}
    for function in {reader.own_process for reader in readers if reader.own_process is not None}:
        own = [path for path, reader in zip(paths, readers, strict=True) if reader.own_process == function]
        packed = next((path for path in own if is_packed(path)), None)
        if packed is not None:
            raise LogError("is packed", source=packed, remedy="unpack it first")
        found |= zip(own, _read_in_own_process(function, own), strict=True)
    for path, reader in zip(paths, readers, strict=True):
        if reader.own_process is not None:
            yield found.pop(path)
        else:
            with unpack_file(path, limit=MAX_TRIAL_BYTES, error=LogError) as plain:
                yield reader.read(plain)


def write_trial(columns: Mapping[str, Array], path: Path) -> None:
    """Write columns, ``(n,)`` each, in the format of the file's suffix, packed where that says so.

    Raises:
        LogError: no format has that suffix.
    """
    reader = reader_for(path)
    if not is_packed(path):
        reader.write(columns, path)
        return
    # Not beside it: another trial may have the plain name.
    folder = TemporaryFolder()
    plain = folder.path / plain_name(path).name
    reader.write(columns, plain)
    pack_file(plain, path)


def _read_in_own_process(function: str, paths: list[Path]) -> list[dict[str, Array]]:
    size = sum(check_file(path, error=LogError).stat().st_size for path in paths)
    try:
        found: list[dict[str, Array]] = in_child(
            function,
            paths,
            source=paths[0],
            error=LogError,
            seconds=_STARTING_S + size / _BYTES_PER_S,
        )
    except LogError:
        if len(paths) == 1:
            raise
        # One by one, to name the file that it was.
        return [_read_in_own_process(function, [path])[0] for path in paths]
    return found
