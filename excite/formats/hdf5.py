"""HDF5 files of any layout: data sets of numbers and texts by their paths, and what attributes say."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.file import check_size, unreadable
from excite.formats.format import ColumnFormat, Content

# The longest array that is a constant of the whole recording: gains of a humanoid with hands.
MOST_CONSTANTS = 100
# Trials in an array of structs.
_MOST_REFERENCES = 1000
_WITHIN = "store the numbers in the file itself"


class Hdf5Format(ColumnFormat):
    """One data set a channel at the root; its library trusts what a file says, so that it runs in a child process."""

    name: ClassVar[str] = "hdf5"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    own_process: ClassVar[bool] = True

    def _read(self, path: Path) -> Content:
        found = hdf5_arrays(path)
        # What lies deeper is no channel: a group, or a field of a record.
        roots = dict.fromkeys(name.partition("/")[0] for name in found)
        check_size(0, len(roots), path)
        columns = {name: found.get(name, np.empty(0, dtype=object)) for name in roots}
        statement = columns.pop("excite", None)
        return Content(columns, "" if statement is None else str(statement))

    def write(self, columns: Mapping[str, NDArray[Any]], path: Path, statement: str = "") -> None:
        """See :meth:`ColumnFormat.write`."""
        import h5py

        with h5py.File(path, "w") as file:
            if statement:
                file.attrs["excite"] = statement
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip", fletcher32=True)


def hdf5_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Data sets of numbers and texts by their paths, and what attributes say by path and name; raises InputError."""
    if importlib.util.find_spec("h5py") is None:
        raise InputError("is HDF5, which needs h5py", source=path, remedy="pip install 'excite[hdf5]'")
    import h5py

    found: dict[str, NDArray[Any]] = {}
    with unreadable(path, "HDF5"), h5py.File(path, "r") as file:
        names = [""]
        file.visit(names.append)
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise InputError("is a link", source=path, field=name[:60], remedy=_WITHIN)
        data_sets = (item for name in names[1:] if isinstance(item := file[name], h5py.Dataset))
        check_size(sum(item.size or 0 for item in data_sets), 0, path)
        for name in names:
            if name.startswith("#refs#"):
                continue
            item = file[name or "/"]
            found |= _read_attributes(name, item.attrs)
            if isinstance(item, h5py.Dataset):
                if item.is_virtual or item.external:
                    raise InputError("lies in another file", source=path, field=name[:60], remedy=_WITHIN)
                found |= _data_set(name, item, file)
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
