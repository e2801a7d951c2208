"""Recordings of arrays by name, whichever format holds them: one a trial where groups or stacks say so."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Recording
from excite.conversion.shapes import longest_streams, split_batches, stream_of_arrays
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.arrays import read_npy, read_npz
from excite.formats.arrow import is_arrow, read_arrow
from excite.formats.file import check_size, first_bytes, is_damage
from excite.formats.hdf5 import MOST_CONSTANTS, hdf5_arrays
from excite.formats.matlab import read_mat
from excite.formats.pickles import flatten_arrays, is_pickled_array, read_pickle, read_torch

Arrays = Mapping[str, Any]
_NUMBERS = "write its arrays one by one, numbers only: numpy.savez(file, q=…, tau=…)"


class ArraySource(Source):
    """Arrays by name, those of groups by their paths.

    Attributes:
        suffixes: of files.
        beginning: how files begin, whatever they are called; empty where their beginning tells nothing.
    """

    own_process: ClassVar[bool] = True
    suffixes: ClassVar[tuple[str, ...]]
    beginning: ClassVar[bytes] = b""

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        start = first_bytes(path, len(self.beginning)) if self.beginning else b""
        return path.is_file() and (
            path.suffix.lower() in self.suffixes or (start != b"" and start == self.beginning)
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        return recordings_of(path, self.arrays(path))

    @abstractmethod
    def arrays(self, path: Path) -> dict[str, Any]:
        """Arrays of a file by name."""


class MatSource(ArraySource):
    """Variables of numbers, and those in structs, by their paths."""

    name: ClassVar[str] = "mat"
    what: ClassVar[str] = "a .mat file"
    summary: ClassVar[str] = "MATLAB (.mat, version 7.3 too)"
    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    beginning: ClassVar[bytes] = b"MATLAB"

    def arrays(self, path: Path) -> dict[str, Any]:
        """See :class:`ArraySource`."""
        return read_mat(path, LogError)


class Hdf5Source(ArraySource):
    """All data sets of numbers; groups at the top with the same names inside are recordings of their own."""

    name: ClassVar[str] = "hdf5"
    what: ClassVar[str] = "HDF5"
    summary: ClassVar[str] = "HDF5 (.h5, .hdf5)"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    beginning: ClassVar[bytes] = b"\x89HDF\r\n\x1a\n"

    def arrays(self, path: Path) -> dict[str, Any]:
        """See :class:`ArraySource`."""
        return hdf5_arrays(path, LogError)


class ParquetSource(ArraySource):
    """A table with numbers, or lists of numbers, in its columns."""

    name: ClassVar[str] = "parquet"
    what: ClassVar[str] = "a table of Arrow"
    summary: ClassVar[str] = "tables of Arrow (.parquet, .feather, .arrow)"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet", ".pq", ".feather", ".arrow")

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return super().recognises(path) or (path.is_file() and is_arrow(path))

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`: one recording, which other columns may part into several."""
        return (
            Recording(str(path), path.stem, longest_streams(stream_of_arrays(path.stem, self.arrays(path)))),
        )

    def arrays(self, path: Path) -> dict[str, Any]:
        """See :class:`ArraySource`."""
        return read_arrow(path, LogError)


class NpzSource(ArraySource):
    """Arrays of one recording, or of one a trial."""

    name: ClassVar[str] = "npz"
    what: ClassVar[str] = "a numpy array"
    summary: ClassVar[str] = "numpy arrays (.npz, .npy)"
    own_process: ClassVar[bool] = False
    suffixes: ClassVar[tuple[str, ...]] = (".npz", ".npy")

    def arrays(self, path: Path) -> dict[str, Any]:
        """See :class:`ArraySource`."""
        if path.suffix.lower() == ".npy":
            return read_npy(path, LogError)
        return read_npz(path, limit=self.limit, longest_text=100_000, error=LogError, remedy=_NUMBERS)


class PaceSource(ArraySource):
    """A dictionary of tensors."""

    name: ClassVar[str] = "pace"
    what: ClassVar[str] = "tensors of torch"
    summary: ClassVar[str] = "tensors saved by torch (.pt, .pth), as PACE writes them"
    suffixes: ClassVar[tuple[str, ...]] = (".pt", ".pth")

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return super().recognises(path) and first_bytes(path, 2) == b"PK"

    def arrays(self, path: Path) -> dict[str, Any]:
        """See :class:`ArraySource`."""
        return read_torch(path)


class PickleSource(Source):
    """Dictionaries and lists of numbers and numpy arrays, by trial or by sample."""

    name: ClassVar[str] = "pickle"
    summary: ClassVar[str] = "pickles of numbers and numpy arrays alone (.pkl, .pickle)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if path.suffix.lower() == ".npy":
            return path.is_file() and is_pickled_array(path)
        return path.is_file() and path.suffix.lower() in {".pkl", ".pickle", ".p"}

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        try:
            trials = read_pickle(path)
        except Exception as error:
            if not is_damage(error):
                raise
            text = " ".join(str(error).split()) or type(error).__name__
            raise LogError(
                f"is a pickle, of which numbers and numpy arrays alone are read, not all that it holds ({text[:160]})",
                source=path,
                remedy="write its arrays with numpy.savez, or its table with to_csv or to_parquet",
            ) from error
        found: list[Recording] = []
        for label, trial in trials.items():
            named = recordings_of(path.with_name(f"{path.stem}{label}"), flatten_arrays(trial))
            found += [replace(recording, source=str(path)) for recording in named]
        return tuple(found)


def recordings_of(path: Path, arrays: Arrays) -> tuple[Recording, ...]:
    """Recordings among arrays by their paths (``trial1/q``): one a trial where they are stacked, or lie in groups."""
    check_size(sum(np.size(values) for values in arrays.values()), 0, path, LogError)
    stacked = {f"{path.stem}_{name}": members for name, members in split_batches(arrays).items()}
    groups = _trial_groups(dict(arrays)) or stacked or {path.stem: dict(arrays)}
    return tuple(
        Recording(
            str(path),
            group or path.stem,
            longest_streams(stream_of_arrays(group or path.stem, members)),
            constants(members),
        )
        for group, members in groups.items()
    )


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
