"""Trials in HDF5 files: one dataset a column."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import LogError
from excite.logs.readers.reader import TrialReader, check_size, no_numbers, unreadable

if TYPE_CHECKING:
    import h5py

    from excite.arrays import Array


class Hdf5Reader(TrialReader):
    """HDF5, one dataset a channel at the root; needs the package ``h5py``.

    The library trusts much of what a file says, so that it runs in a process of its own.
    """

    name: ClassVar[str] = "hdf5"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    own_process: ClassVar[str | None] = f"{__name__}:read_hdf5"

    def _columns(self, path: Path) -> dict[str, Array]:
        _require_h5py(path)
        import h5py

        try:
            with h5py.File(path, "r") as file:
                datasets = _root_datasets(file, path)
                sizes = [math.prod(item.shape) for item in datasets.values() if _is_readable(item)]
                check_size(sum(sizes), len(datasets), path)
                return {name: _read_dataset(item) for name, item in datasets.items()}
        # What h5py raises of damaged files.
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, AttributeError) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        _require_h5py(path)
        import h5py

        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip", fletcher32=True)


def read_hdf5(paths: list[Path]) -> list[dict[str, Array]]:
    """Columns of files, read in this process."""
    return [Hdf5Reader().read(path) for path in paths]


def _root_datasets(file: h5py.File, path: Path) -> dict[str, h5py.Dataset]:
    """Datasets at the root that hold their data themselves; raises LogError for those that lie elsewhere."""
    import h5py

    check_size(0, len(file), path)
    found = {}
    for name in file:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            raise LogError(
                "is a link", source=path, field=name[:60], remedy="store the numbers in the file itself"
            )
        item = file[name]
        if not isinstance(item, h5py.Dataset):
            continue
        if item.is_virtual or item.external:
            raise LogError(
                "lies in another file",
                source=path,
                field=name[:60],
                remedy="store the numbers in the file itself",
            )
        found[name] = item
    return found


def _is_readable(item: h5py.Dataset) -> bool:
    return item.dtype.kind in "fiu" and len(item.shape or ()) in {1, 2}


def _read_dataset(item: h5py.Dataset) -> NDArray[Any]:
    return np.asarray(item[()]) if _is_readable(item) else no_numbers(item.dtype)


def _require_h5py(path: Path) -> None:
    if importlib.util.find_spec("h5py") is None:
        raise LogError(
            "HDF5 needs the package h5py", source=path, remedy="pip install h5py, or use .parquet, .csv, .npz"
        )
