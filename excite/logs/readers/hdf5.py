"""Trials in HDF5."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.errors import LogError
from excite.logs.readers.reader import TrialReader, unreadable
from excite.robot.robot import Array


class Hdf5Reader(TrialReader):
    """HDF5, one dataset a channel at the root; needs the package ``h5py``."""

    name: ClassVar[str] = "hdf5"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def read(self, path: Path) -> dict[str, Array]:
        """See :meth:`TrialReader.read`."""
        _require_h5py(path)
        import h5py

        try:
            with h5py.File(path, "r") as file:
                return {
                    name: np.asarray(item) for name, item in file.items() if isinstance(item, h5py.Dataset)
                }
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        _require_h5py(path)
        import h5py

        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip")


def _require_h5py(path: Path) -> None:
    if importlib.util.find_spec("h5py") is None:
        raise LogError(
            "HDF5 needs the package h5py", source=path, remedy="pip install h5py, or use .parquet, .csv, .npz"
        )
