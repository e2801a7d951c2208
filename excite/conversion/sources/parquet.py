"""Files of Arrow tables, Parquet and Feather: numbers a column, or a list of numbers a row."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes import longest_streams, stream_of_arrays
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.arrow import read_feather, read_parquet, table_arrays
from excite.formats.file import MAX_FILE_BYTES, check_file, check_size, first_bytes, unreadable

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
        check_file(path, limit=MAX_FILE_BYTES, error=LogError)
        with unreadable(path, LogError, "a table of Arrow"):
            table = read_feather(path) if first_bytes(path, 4) == _FEATHER else read_parquet(path)
            check_size(table.num_rows * table.num_columns, 0, path, LogError)
            arrays = table_arrays(table)
        streams = longest_streams(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams),)
