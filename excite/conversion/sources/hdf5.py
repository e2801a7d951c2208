"""HDF5 files of any layout: data sets by their paths, groups that hold trials apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, split_batches, stream_of_arrays
from excite.conversion.sources.npz import MOST_CONSTANTS, constants
from excite.conversion.sources.source import MAX_NUMBERS, MAX_SOURCE_BYTES, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# Trials in an array of structs.
_MOST_REFERENCES = 1000
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


def hdf5_arrays(path: Path) -> dict[str, Any]:
    """Data sets of numbers and texts by their paths, and what attributes say by path and name; raises LogError."""
    try:
        import h5py
    except ImportError as error:
        raise LogError(
            "is HDF5, which needs h5py", source=path, remedy="pip install 'excite[hdf5]'"
        ) from error
    found: dict[str, Any] = {}
    try:
        with h5py.File(path, "r") as file:
            names = [""]
            file.visit(names.append)
            for name in names:
                if name.startswith("#refs#"):
                    continue
                item = file[name or "/"]
                found |= _read_attributes(name, item.attrs)
                if isinstance(item, h5py.Dataset):
                    found |= _data_set(name, item, file)
                if sum(np.size(values) for values in found.values()) > MAX_NUMBERS:
                    raise LogError(
                        "holds more numbers than can be read", source=path, remedy="split the recording"
                    )
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise damaged(path, error, "HDF5") from error
    return found


def _read_attributes(name: str, attributes: Any) -> dict[str, Any]:
    """Numbers and texts that attributes hold; MATLAB's own describe its classes."""
    found = {}
    for key, value in attributes.items():
        texts = _read_texts(value)
        if texts is not None:
            found[f"{name}/{key}" if name else str(key)] = texts
        elif np.asarray(value).dtype.kind in "fiu" and np.size(value) <= MOST_CONSTANTS:
            found[f"{name}/{key}" if name else str(key)] = np.asarray(value)
    return {key: value for key, value in found.items() if "MATLAB" not in key and "H5PATH" not in key}


def _data_set(name: str, item: Any, file: Any) -> dict[str, Any]:
    """A data set of numbers or texts; what references in it point at, numbered, as MATLAB writes arrays of structs."""
    import h5py

    if item.size is not None and item.size > MAX_NUMBERS:
        raise ValueError("it holds more numbers than can be read")
    if h5py.check_dtype(ref=item.dtype) is not None:
        if item.size > _MOST_REFERENCES:
            return {}
        targets = [file[reference] for reference in np.ravel(item[()]) if reference]
        if targets and all(target.attrs.get("MATLAB_class") == b"char" for target in targets):
            return {name: np.array(["".join(map(chr, np.ravel(target[()]))) for target in targets])}
        group, _, field = name.rpartition("/")
        return {
            f"{group}{k + 1}/{field}" if group else f"{field}{k + 1}": np.asarray(target[()])
            for k, target in enumerate(targets)
            if isinstance(target, h5py.Dataset) and target.dtype.kind in "fiub"
        }
    if item.dtype.names:
        # Rows of records, as tables are: a data set a field.
        rows = item[()]
        return {
            f"{name}/{key}": np.asarray(rows[key])
            for key in item.dtype.names
            if rows[key].dtype.kind in "fiub"
        }
    if item.dtype.kind in "fiub":
        return {name: np.asarray(item[()])}
    texts = _read_texts(item[()]) if item.dtype.kind in "SO" else None
    return {} if texts is None else {name: texts}


def _read_texts(value: object) -> Any:
    """Texts as an array; None where it holds others."""
    array = np.asarray(value)
    cells = [cell.decode("utf-8", "replace") if isinstance(cell, bytes) else cell for cell in array.ravel()]
    if not cells or not all(isinstance(cell, str) for cell in cells):
        return None
    return np.array(cells, dtype=str).reshape(array.shape)
