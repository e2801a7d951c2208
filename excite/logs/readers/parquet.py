"""Trials in Apache Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pyarrow.parquet

from excite.arrow_columns import arrow_table, numpy_columns, read_parquet
from excite.logs.readers.reader import TrialReader, unreadable
from excite.robot.robot import Array


class ParquetReader(TrialReader):
    """Apache Parquet, one column a channel."""

    name: ClassVar[str] = "parquet"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)

    def read(self, path: Path) -> dict[str, Array]:
        """See :meth:`TrialReader.read`."""
        try:
            return numpy_columns(read_parquet(path))
        except (OSError, pa.ArrowException) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        pa.parquet.write_table(arrow_table(columns), path, compression="zstd")
