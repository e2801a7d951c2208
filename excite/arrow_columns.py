"""Columns of Arrow tables as numpy arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray


def read_parquet(path: Path) -> pa.Table:
    """The table of a Parquet file, raising what Arrow and the file system raise.

    Of one file: the reader of data sets would load pandas where that is installed, which takes 0.2 s.
    """
    with pa.parquet.ParquetFile(path) as file:
        return file.read()


def numpy_columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    """Columns by name; numbers without gaps by DLPack, as Arrow's own conversion would load pandas for them too."""
    return {name: _numpy(table[name]) for name in table.column_names}


def _numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    number = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    if not number or column.null_count or not column.num_chunks:
        return column.to_numpy()
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])
