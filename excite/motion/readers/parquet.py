"""Reads motions of ``excite.motion/1`` from Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pyarrow.parquet

from excite.arrow_columns import numpy_columns, read_parquet
from excite.errors import MotionError
from excite.motion.readers.reader import (
    DAMAGED,
    MAX_FILE_BYTES,
    MAX_VALUES,
    MotionReader,
    RawMotion,
    check_once,
    of_ours,
    unreadable,
)
from excite.reading.file import check_file
from excite.reading.json_document import parse_json


class ParquetReader(MotionReader):
    """One column a channel; what the file says of itself is JSON under the key ``excite``."""

    name: ClassVar[str] = "parquet"
    summary: ClassVar[str] = "excite.motion/1 in Parquet"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".parquet"

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        check_file(path, limit=MAX_FILE_BYTES, error=MotionError)
        try:
            found = pa.parquet.read_metadata(path)
            if found.num_rows * found.num_columns > MAX_VALUES:
                raise MotionError(
                    f"holds {found.num_rows} rows of {found.num_columns} columns",
                    source=path,
                    remedy="check that it is a motion",
                )
            table = read_parquet(path)
            check_once(table.column_names, path)
            said = (table.schema.metadata or {}).get(b"excite")
            metadata = {} if said is None else of_ours(parse_json(said.decode()))
            columns = numpy_columns(table)
        except DAMAGED as error:
            raise unreadable(path, error) from error
        return RawMotion(columns, metadata)
