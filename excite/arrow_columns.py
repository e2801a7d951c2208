"""Columns of Arrow tables as numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray


def open_parquet(path: Path) -> pa.parquet.ParquetFile:
    """A Parquet file whose pages are compared with their check sums, where they have any.

    Of one file: the reader of data sets would load pandas where that is installed, which takes 0.2 s.
    """
    return pa.parquet.ParquetFile(path, page_checksum_verification=True)


def read_parquet(path: Path) -> pa.Table:
    """The table of a Parquet file, raising what Arrow and the file system raise."""
    with open_parquet(path) as file:
        return file.read()


def read_numbers(file: pa.parquet.ParquetFile) -> dict[str, NDArray[Any]]:
    """Columns of an open Parquet file by name; others than numbers stay unread and come without rows.

    A word that a file says once may stand for a billion of them; numbers take what their count says.

    Raises:
        ValueError: a name stands twice; also what Arrow and the file system raise.
    """
    schema = file.schema_arrow
    names = schema.names
    if len(set(names)) < len(names):
        raise ValueError(f"column {next(n for n in names if names.count(n) > 1)[:60]!r} stands twice")
    numbers = [field.name for field in schema if _is_number(field.type)]
    # All of them by no name: a name would also choose those that it begins.
    table = file.read() if len(numbers) == len(names) else file.read(columns=numbers).select(numbers)
    columns = table.columns
    # A column at a time, so that a long recording is not in memory twice.
    del table
    found = {name: _to_numpy(columns.pop(0)) for name in numbers}
    return {name: found.get(name, np.empty(0, dtype=object)) for name in names}


def arrow_table(columns: Mapping[str, NDArray[Any]]) -> pa.Table:
    """A table of columns by name; numbers by their bytes, as Arrow's own conversion would load pandas for them too."""
    return pa.Table.from_arrays([_to_arrow(column) for column in columns.values()], names=list(columns))


def _to_arrow(column: NDArray[Any]) -> pa.Array:
    column = np.asarray(column)
    if column.ndim != 1 or column.dtype.kind not in "fiu" or not column.dtype.isnative:
        return pa.array(column)
    kind, data = pa.from_numpy_dtype(column.dtype), pa.py_buffer(np.ascontiguousarray(column))
    return pa.Array.from_buffers(kind, len(column), [None, data])


def numpy_columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    """Columns by name; numbers without gaps by DLPack, as Arrow's own conversion would load pandas for them too."""
    return {name: _to_numpy(table[name]) for name in table.column_names}


def _to_numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    if not _is_number(column.type) or column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy())
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))
