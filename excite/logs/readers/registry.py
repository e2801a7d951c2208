"""The formats of trial files that are known, by name."""

from __future__ import annotations

from pathlib import Path

from excite.errors import LogError
from excite.logs.readers.csv import CsvReader
from excite.logs.readers.hdf5 import Hdf5Reader
from excite.logs.readers.npz import NpzReader
from excite.logs.readers.parquet import ParquetReader
from excite.logs.readers.reader import TrialReader

READERS: dict[str, type[TrialReader]] = {
    reader.name: reader for reader in (ParquetReader, CsvReader, NpzReader, Hdf5Reader)
}


def reader_for(path: Path) -> TrialReader:
    """The reader of a file by its suffix.

    Raises:
        LogError: no format has that suffix.
    """
    for reader in READERS.values():
        if path.suffix.lower() in reader.suffixes:
            return reader()
    known = ", ".join(suffix for reader in READERS.values() for suffix in reader.suffixes)
    raise LogError(f"unknown format {path.suffix!r}", source=path, remedy=f"use one of {known}")
