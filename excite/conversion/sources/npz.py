"""npz archives: arrays by name, short ones are constants; npy: one array, or a table of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, split_batches, stream_of_arrays
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.arrays import read_npy, read_npz
from excite.formats.hdf5 import MOST_CONSTANTS

_REMEDY = "write its arrays one by one, numbers only: numpy.savez(file, q=…, tau=…)"


class NpzSource(Source):
    """Arrays of one recording."""

    name: ClassVar[str] = "npz"
    summary: ClassVar[str] = "numpy arrays (.npz, .npy)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and path.suffix.lower() in {".npz", ".npy"}

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        if path.suffix.lower() == ".npy":
            arrays = read_npy(path, LogError)
        else:
            arrays = read_npz(path, limit=2_000_000_000, longest_text=100_000, error=LogError, remedy=_REMEDY)
        return recordings_of(path, arrays)


def recordings_of(path: Path, arrays: dict[str, Any]) -> tuple[Recording, ...]:
    """The recording that arrays are, or one a trial where they are stacked; raises LogError for none."""
    trials = {f"{path.stem}_{name}": members for name, members in split_batches(arrays).items()} or {
        path.stem: arrays
    }
    found = []
    for name, members in trials.items():
        streams = longest_streams(stream_of_arrays(name, members))
        if streams:
            found.append(Recording(str(path), name, streams, constants(members)))
    if not found:
        raise nothing_there(path)
    return tuple(found)


def constants(arrays: dict[str, np.ndarray]) -> dict[str, object]:
    """Numbers and short lists of numbers among arrays, as lists; words as text."""
    said: dict[str, object] = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        if array.dtype.kind in "fiu" and array.size <= MOST_CONSTANTS:
            said[name] = np.squeeze(array).tolist()
        elif array.dtype.kind == "U" and array.size <= MOST_CONSTANTS:
            said[name] = np.squeeze(array).tolist()
    return said
