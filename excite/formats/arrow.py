"""Apache Parquet: tables of Arrow as numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from excite.formats.file import check_size, check_unique, unreadable
from excite.formats.format import ColumnFormat, Content

# Numbers that are laid out for writing at once, 80 MB: a long recording is not held a second time for it.
_GROUP = 10_000_000


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

    Raises what Arrow and the file system raise.
    """
    schema = file.schema_arrow
    names = schema.names
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


class ParquetFormat(ColumnFormat):
    """Apache Parquet, one column a channel; a statement stands in its metadata under the key ``excite``."""

    name: ClassVar[str] = "parquet"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)

    def _read(self, path: Path) -> Content:
        with open_parquet(path) as file:
            check_unique(file.schema_arrow.names, path)
            check_size(file.metadata.num_rows * file.metadata.num_columns, file.metadata.num_columns, path)
            said = (file.schema_arrow.metadata or {}).get(b"excite") or (file.metadata.metadata or {}).get(
                b"excite"
            )
            return Content(read_numbers(file), (said or b"").decode())

    def write(self, columns: Mapping[str, NDArray[Any]], path: Path, statement: str = "") -> None:
        """See :meth:`ColumnFormat.write`."""
        length = max((len(column) for column in columns.values()), default=0)
        rows = max(1, _GROUP // max(len(columns), 1))
        schema = arrow_table({name: column[:0] for name, column in columns.items()}).schema
        kinds = {name: np.asarray(column).dtype for name, column in columns.items()}
        with pa.parquet.ParquetWriter(
            path,
            schema,
            compression="zstd",
            write_page_checksum=True,
            # Numbers hardly ever come twice: dictionaries of them take as long to write as all else, and more room.
            use_dictionary=[name for name, kind in kinds.items() if kind.kind != "f"],
            # Bytes of equal weight side by side compress where the numbers themselves do not; a hundred short columns
            # would spend as much on statistics and the schema as on data.
            use_byte_stream_split=[name for name, kind in kinds.items() if kind == np.float32],
            write_statistics=False,
            store_schema=False,
        ) as file:
            for start in range(0, max(length, 1), rows):
                part = {name: column[start : start + rows] for name, column in columns.items()}
                file.write_table(arrow_table(part))
            if statement:
                file.add_key_value_metadata({"excite": statement})


# Tables of any making: lists of numbers in rows, records, texts.


def parquet_arrays(path: Path) -> dict[str, Any]:
    """Columns of Parquet as :func:`table_arrays` has them; raises InputError."""
    with unreadable(path, "a Parquet file"):
        table = read_parquet(path)
        check_size(table.num_rows * table.num_columns, 0, path)
        return table_arrays(table)


def table_arrays(table: pa.Table) -> dict[str, Any]:
    """Columns of numbers, ``(n,)``, and of lists of one length, ``(n, k)``, by name."""
    found: dict[str, Any] = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        if isinstance(column, pa.ChunkedArray):
            column = column.chunk(0) if column.num_chunks else pa.array([])
        _collect_column(name, column, found)
    return found


def _collect_column(name: str, column: pa.Array, found: dict[str, Any]) -> None:
    """The numbers and texts of a column by name; of records their fields, of lists of records an array a field."""
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    kind = column.type
    if pa.types.is_struct(kind):
        for field, inner in zip(kind, column.flatten(), strict=True):
            _collect_column(f"{name}/{field.name}", inner, found)
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        _collect_lists(name, column, found)
    elif pa.types.is_timestamp(kind):
        found[name] = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy(zero_copy_only=False) * 1e-9
    elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
        found[name] = np.asarray(column.to_numpy(zero_copy_only=False), dtype=object)
    elif _is_number(kind) or pa.types.is_boolean(kind):
        found[name] = np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)


def _collect_lists(name: str, column: pa.Array, found: dict[str, Any]) -> None:
    """Lists of one length, ``(n, k)``: of numbers, of words, or of records."""
    flat = column.flatten()
    if not len(column) or not len(flat) or len(flat) % len(column):
        return
    inside: dict[str, Any] = {}
    _collect_column(name, flat, inside)
    for key, values in inside.items():
        if values.ndim == 1:
            rows = values.reshape(len(column), -1)
            found[key] = rows.astype(str) if rows.dtype.kind == "O" else rows
