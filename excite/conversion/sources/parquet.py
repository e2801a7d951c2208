"""Files of Arrow tables, Parquet and Feather: numbers a column, or a list of numbers a row."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa

from excite.arrow_columns import read_parquet
from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, stream_of_arrays
from excite.conversion.sources.source import MAX_NUMBERS, MAX_SOURCE_BYTES, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# What files of Arrow's own format, the second of Feather, begin with.
_FEATHER = b"ARRO"


class ParquetSource(Source):
    """A table with numbers, or lists of numbers, in its columns."""

    name: ClassVar[str] = "parquet"
    summary: ClassVar[str] = "tables of Arrow (.parquet, .feather, .arrow)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (
            path.suffix.lower() in {".parquet", ".pq", ".feather", ".arrow"}
            or first_bytes(path, 4) in (b"PAR1", _FEATHER)
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
        try:
            of_feather = first_bytes(path, 4) == _FEATHER
            arrays = table_arrays(_read_feather(path) if of_feather else read_parquet(path))
        except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
            raise damaged(path, error, "a table of Arrow") from error
        streams = longest_streams(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams),)


def _read_feather(path: Path) -> pa.Table:
    with pa.ipc.open_file(str(path)) as file:
        return file.read_all()


def table_arrays(table: pa.Table) -> dict[str, Any]:
    """Columns of numbers, ``(n,)``, and of lists of one length, ``(n, k)``, by name."""
    if table.num_rows * table.num_columns > MAX_NUMBERS:
        raise ValueError(f"{table.num_rows} rows of {table.num_columns} columns are more than can be read")
    found: dict[str, Any] = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        if isinstance(column, pa.ChunkedArray):
            column = column.chunk(0) if column.num_chunks else pa.array([])
        _collect(name, column, found)
    return found


def _collect(name: str, column: pa.Array, found: dict[str, Any]) -> None:
    """The numbers and texts of a column by name; of records their fields, of lists of records an array a field."""
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    kind = column.type
    if pa.types.is_struct(kind):
        for field, inner in zip(kind, column.flatten(), strict=True):
            _collect(f"{name}/{field.name}", inner, found)
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
    _collect(name, flat, inside)
    for key, values in inside.items():
        if values.ndim == 1:
            rows = values.reshape(len(column), -1)
            found[key] = rows.astype(str) if rows.dtype.kind == "O" else rows


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))
