"""Trials in comma-separated text with one line of names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import arrow_table, numpy_columns
from excite.logs.readers.reader import TrialReader, unreadable
from excite.robot.robot import Array


class CsvReader(TrialReader):
    """Comma-separated values, names in the first line, ``#`` lines before it left out."""

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path: Path) -> dict[str, Array]:
        """See :meth:`TrialReader.read`."""
        try:
            with path.open("rb") as stream:
                start = stream.tell()
                while (line := stream.readline()).startswith(b"#"):
                    start += len(line)
                stream.seek(start)
                table = pa.csv.read_csv(stream)
        except (OSError, pa.ArrowException) as error:
            raise unreadable(path, error) from error
        return {name.strip(): column for name, column in numpy_columns(table).items()}

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        pa.csv.write_csv(arrow_table(columns), path, write_options=pa.csv.WriteOptions(quoting_style="none"))
