"""The formats of trial files that are known, by name. A new one is one file beside this one and its line here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.readers.csv import CsvReader
from excite.logs.readers.hdf5 import Hdf5Reader
from excite.logs.readers.npz import NpzReader
from excite.logs.readers.parquet import ParquetReader
from excite.logs.readers.reader import MAX_TRIAL_BYTES, TrialReader
from excite.reading.child import in_child
from excite.reading.file import check_file, is_packed, pack_file, plain_name, unpack_file
from excite.temporary_folder import TemporaryFolder

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
