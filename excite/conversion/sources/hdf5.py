"""HDF5 files of any layout: data sets by their paths, groups that hold trials apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, split_batches, stream_of_arrays
from excite.conversion.sources.npz import constants
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.file import MAX_FILE_BYTES, check_file, first_bytes
from excite.formats.hdf5 import MOST_CONSTANTS, hdf5_arrays

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
        check_file(path, limit=MAX_FILE_BYTES, error=LogError)
        return recordings_of(path, hdf5_arrays(path, LogError))


def recordings_of(path: Path, arrays: dict[str, Any]) -> tuple[Recording, ...]:
    """Recordings among data sets by their paths (``trial1/q``): one a group where groups hold the same names."""
    groups = _trial_groups(arrays) or split_batches(arrays) or {path.stem: arrays}
    found = []
    for group, members in groups.items():
        streams = longest_streams(stream_of_arrays(group or path.stem, members))
        if streams:
            found.append(Recording(str(path), group or path.stem, streams, constants(members)))
    if not found:
        raise nothing_there(path)
    return tuple(found)


def _trial_groups(arrays: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Data sets of each trial by its group, however deep the groups lie; empty where there are no such groups."""
    groups: dict[str, dict[str, Any]] = {}
    for name, values in arrays.items():
        group, _, rest = name.partition("/")
        groups.setdefault(group if rest else "", {})[rest or name] = values
    shared = groups.pop("", {})
    if not _is_constant(shared):
        return {}
    # What describes the recordings (``info``, ``meta``) is none of them.
    for group in [group for group, members in groups.items() if _is_constant(members)]:
        shared |= {f"{group}/{name}": values for name, values in groups.pop(group).items()}
    if len(groups) == 1:
        ((group, members),) = groups.items()
        return {name: shared | inner for name, inner in _trial_groups(members).items()}
    inner = [frozenset(found) for found in groups.values()]
    if not inner or 2 * len(frozenset.intersection(*inner)) < len(frozenset.union(*inner)):
        return {}
    # Logs of a simulation have a group a signal, each with the same fields in it.
    said = [read_clue(group, ()).quantity for group in groups]
    if len(set(said)) > 1 and all(said):
        return {}
    return {group: shared | members for group, members in groups.items()}


def _is_constant(members: dict[str, Any]) -> bool:
    """Whether no data set is long enough for a signal."""
    return all(np.size(values) <= MOST_CONSTANTS for values in members.values())
