"""Trials in Apache Parquet: one table, a column a channel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pyarrow.parquet

from excite.arrays import Array
from excite.arrow_columns import arrow_table, open_parquet, read_numbers
from excite.logs.readers.reader import TrialReader, check_size, unreadable

# Numbers that are laid out for writing at once, 80 MB: a long recording is not held a second time for it.
_GROUP = 10_000_000


class ParquetReader(TrialReader):
    """Apache Parquet, one column a channel."""

    name: ClassVar[str] = "parquet"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)

    def _columns(self, path: Path) -> dict[str, Array]:
        try:
            with open_parquet(path) as file:
                rows, columns = file.metadata.num_rows, file.metadata.num_columns
                check_size(rows * columns, columns, path)
                return read_numbers(file)
        except (OSError, ValueError, KeyError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        length = max((len(column) for column in columns.values()), default=0)
        rows = max(1, _GROUP // max(len(columns), 1))
        schema = arrow_table({name: column[:0] for name, column in columns.items()}).schema
        with pa.parquet.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True) as file:
            for start in range(0, max(length, 1), rows):
                part = {name: column[start : start + rows] for name, column in columns.items()}
                file.write_table(arrow_table(part))
