"""Columns of Arrow tables as numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
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


def arrow_table(columns: Mapping[str, NDArray[Any]]) -> pa.Table:
    """A table of columns by name; numbers by their bytes, as Arrow's own conversion would load pandas for them too."""
    return pa.Table.from_arrays([_arrow(column) for column in columns.values()], names=list(columns))


def _arrow(column: NDArray[Any]) -> pa.Array:
    column = np.asarray(column)
    if column.ndim != 1 or column.dtype.kind not in "fiu" or not column.dtype.isnative:
        return pa.array(column)
    kind, data = pa.from_numpy_dtype(column.dtype), pa.py_buffer(np.ascontiguousarray(column))
    return pa.Array.from_buffers(kind, len(column), [None, data])


def numpy_columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    """Columns by name; numbers without gaps by DLPack, as Arrow's own conversion would load pandas for them too."""
    return {name: _numpy(table[name]) for name in table.column_names}


def _numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    number = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    if not number or column.null_count or not column.num_chunks:
        return column.to_numpy()
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])
