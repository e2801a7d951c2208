"""HDF5 files of any layout: data sets by their paths, groups that hold trials apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, longest, nothing_there, stream_of_arrays
from excite.conversion.sources.npz import constants
from excite.conversion.sources.source import MAX_NUMBERS, MAX_SOURCE_BYTES, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

_MAGIC = b"\x89HDF\r\n\x1a\n"


class Hdf5Source(Source):
    """All data sets of numbers; groups at the top with the same names inside are recordings of their own."""

    name: ClassVar[str] = "hdf5"
    summary: ClassVar[str] = "HDF5 (.h5, .hdf5)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (path.suffix.lower() in {".h5", ".hdf5"} or first_bytes(path, 8) == _MAGIC)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
        return recordings_of(path, hdf5_arrays(path))


def recordings_of(path: Path, arrays: dict[str, Any]) -> tuple[Recording, ...]:
    """Recordings among data sets by their paths (``trial1/q``): one a group where groups hold the same names."""
    groups: dict[str, dict[str, Any]] = {}
    for name, values in arrays.items():
        group, _, rest = name.partition("/")
        groups.setdefault(group if rest else "", {})[rest or name] = values
    inner = [frozenset(found) for group, found in groups.items() if group]
    if len(inner) < 2 or len(set(inner)) > 1 or "" in groups:
        groups = {path.stem: arrays}
    found = []
    for group, members in groups.items():
        streams = longest(stream_of_arrays(group or path.stem, members))
        if streams:
            found.append(Recording(str(path), group or path.stem, streams, constants(members)))
    if not found:
        raise nothing_there(path)
    return tuple(found)


def hdf5_arrays(path: Path) -> dict[str, Any]:
    """Data sets of numbers by their paths; raises LogError."""
    try:
        import h5py
    except ImportError as error:
        raise LogError(
            "is HDF5, which needs h5py", source=path, remedy="pip install 'excite[hdf5]'"
        ) from error
    found: dict[str, Any] = {}
    total = 0
    try:
        with h5py.File(path, "r") as file:
            names: list[str] = []
            file.visit(names.append)
            for name in names:
                item = file[name]
                if (
                    not isinstance(item, h5py.Dataset)
                    or item.dtype.kind not in "fiub"
                    or name.startswith("#refs#")
                ):
                    continue
                total += item.size
                if total > MAX_NUMBERS:
                    raise LogError(
                        "holds more numbers than can be read", source=path, remedy="split the recording"
                    )
                found[name] = np.asarray(item[()])
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise damaged(path, error, "HDF5") from error
    return found
