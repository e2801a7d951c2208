"""Columns of a motion in a Parquet file, in full or in as few bytes as a plan needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from excite.arrow_columns import arrow_table

_POSITIONS = ("q.", "base.p", "base.q")


def write_parquet(columns: dict[str, NDArray[Any]], metadata: str, path: Path, *, single: bool) -> None:
    """Write columns of one length.

    Args:
        columns: by name, times in ``time``.
        metadata: text kept under the key ``excite``.
        path: where to.
        single: the columns are :func:`narrow_columns`, and are laid out so that they take little room.
    """
    if not single:
        table = arrow_table(columns).replace_schema_metadata({"excite": metadata})
        # Dictionaries of numbers that hardly ever come twice take as long to write as all else, and more room.
        flags = [name for name, column in columns.items() if column.dtype.kind != "f"]
        pa.parquet.write_table(table, path, compression="zstd", use_dictionary=flags, write_statistics=False)
        return
    table = arrow_table(columns)
    # Bytes of equal weight side by side compress where the numbers themselves do not; a hundred short columns
    # would spend as much on statistics as on data.
    split = [name for name, column in columns.items() if column.dtype == np.float32]
    with pa.parquet.ParquetWriter(
        path,
        table.schema,
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=split,
        write_statistics=False,
        store_schema=False,
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({"excite": metadata})


def narrow_columns(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Columns in few bytes: positions in single precision, velocities and accelerations to 16 binary digits."""
    return {name: _narrow_column(name, column) for name, column in columns.items()}


def _narrow_column(name: str, column: NDArray[Any]) -> NDArray[Any]:
    if name == "time":
        return column
    if column.dtype != float:
        return column.astype(np.int8)
    single = column.astype(np.float32)
    if name.startswith(_POSITIONS):
        return single
    return ((single.view(np.uint32) + np.uint32(0x80)) & np.uint32(0xFFFFFF00)).view(np.float32)
