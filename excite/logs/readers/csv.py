"""Trials in comma-separated text with one line of names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, ClassVar

import pyarrow as pa
import pyarrow.csv

from excite.arrays import Array
from excite.arrow_columns import arrow_table, numpy_columns
from excite.errors import LogError
from excite.logs.readers.reader import MAX_COLUMNS, TrialReader, check_size, unreadable

# The longest line of names or of comments: as many columns as are read, of fifty letters each [bytes].
_LONGEST_LINE = 50 * MAX_COLUMNS
_MOST_COMMENTS = 1000


class CsvReader(TrialReader):
    """Comma-separated values, names in the first line, ``#`` lines before it left out."""

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def _columns(self, path: Path) -> dict[str, Array]:
        try:
            with path.open("rb") as stream:
                stream.seek(_names_line_start(stream, path))
                table = pa.csv.read_csv(stream)
            names = [name.strip() for name in table.column_names]
        except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise LogError("stands twice", source=path, field=twice[0][:60], remedy="keep one of the columns")
        check_size(table.num_rows * len(names), len(names), path)
        try:
            return numpy_columns(table.rename_columns(names))
        except (ValueError, MemoryError, pa.ArrowException) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        pa.csv.write_csv(arrow_table(columns), path, write_options=pa.csv.WriteOptions(quoting_style="none"))


def _names_line_start(stream: BinaryIO, path: Path) -> int:
    """Where the line of names begins, which has to be one; raises LogError."""
    for _ in range(_MOST_COMMENTS):
        start = stream.tell()
        line = stream.readline(_LONGEST_LINE + 1)
        if len(line) > _LONGEST_LINE:
            raise LogError(
                f"has a line of more than {_LONGEST_LINE} bytes where the columns' names should stand",
                source=path,
                remedy="check that it is the right file",
            )
        if not line.startswith(b"#"):
            check_size(0, line.count(b",") + 1, path)
            return start
    raise LogError(
        f"begins with more than {_MOST_COMMENTS} lines of comments",
        source=path,
        remedy="check that it is the right file",
    )
