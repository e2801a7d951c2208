"""npz archives: arrays ``(n,)`` and ``(n, k)`` by name; short ones are constants."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.conversion.recording import Recording, longest, nothing_there, stream_of_arrays
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.reading.npz_arrays import read_npz

# The longest array that is a constant of the whole recording: gains of a humanoid with hands.
MOST_CONSTANTS = 100


class NpzSource(Source):
    """Arrays of one recording."""

    name: ClassVar[str] = "npz"
    summary: ClassVar[str] = "numpy arrays (.npz)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and path.suffix.lower() == ".npz"

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        arrays = read_npz(path, limit=2_000_000_000, longest_text=100_000, error=LogError)
        streams = longest(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams, constants(arrays)),)


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
