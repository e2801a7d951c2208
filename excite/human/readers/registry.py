"""Which reader answers to which ending."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from excite.errors import LogError
from excite.human.readers.c3d import MAX_C3D_BYTES, C3dReader
from excite.human.readers.csv import CsvReader
from excite.human.readers.plausible import check_recording
from excite.human.readers.reader import RecordingReader
from excite.human.readers.storage import StorageReader
from excite.human.readers.trc import TrcReader
from excite.human.recording import Recording
from excite.reading.packed import plain_name, unpack_file

READERS: tuple[RecordingReader, ...] = (C3dReader(), TrcReader(), StorageReader(), CsvReader())


def read_recording(path: Path) -> Recording:
    """Read a file by its ending.

    Raises:
        LogError: no reader for it, or it is malformed.
    """
    for reader in READERS:
        if plain_name(path).suffix.lower() in reader.suffixes:
            with unpack_file(path, limit=MAX_C3D_BYTES, error=LogError) as plain:
                return check_recording(replace(reader.read(plain), source=path))
    known = ", ".join(suffix for reader in READERS for suffix in reader.suffixes)
    raise LogError(f"no reader for {path.suffix[:60]!r}", source=path, remedy=f"use one of {known}")
