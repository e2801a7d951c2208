"""npz archives: arrays by name, short ones are constants; npy: one array, or a table of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, split_batches, stream_of_arrays
from excite.conversion.sources.source import MAX_SOURCE_BYTES, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file
from excite.reading.numpy_files import read_npz

# The longest array that is a constant of the whole recording: gains of a humanoid with hands.
MOST_CONSTANTS = 100
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
            arrays = _one_array(path)
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


def _one_array(path: Path) -> dict[str, np.ndarray]:
    """The array of a ``.npy`` under the file's name, or its fields under theirs; raises LogError."""
    check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
    try:
        # Mapped, so that a shape beyond the file's end is refused before memory is asked for.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, SyntaxError, OverflowError, MemoryError) as error:
        if "Python objects" in str(error):
            raise LogError(
                "holds pickled Python objects, which are not opened",
                source=path,
                remedy="write its arrays one by one: numpy.savez(file, q=…, tau=…)",
            ) from error
        raise damaged(path, error, "a numpy array") from error
    if array.dtype.names:
        return {name: np.asarray(array[name]) for name in array.dtype.names}
    return {path.stem: np.asarray(array)}


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
