"""Rows of numbers for controllers, whose columns a comment at the top names."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.errors import MotionError
from excite.motion.readers.reader import DAMAGED, MAX_FILE_BYTES, MotionReader, RawMotion, unreadable
from excite.motion.readers.remarks import of_robot, stated_in_comments
from excite.reading.file import check_file, first_bytes

# Warnings of an unsafe motion stand above the statement.
_BEGINNING = 1 << 18
_MARK = b'"columns": ['


class RowsReader(MotionReader):
    """Numbers between spaces, a row a period; ``columns`` and ``rate_hz`` in a comment that is a JSON object."""

    name: ClassVar[str] = "rows"
    summary: ClassVar[str] = "rows of numbers that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if path.suffix != ".txt":
            return False
        start = first_bytes(path, _BEGINNING)
        return start.startswith(b"#") and _MARK in start

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        check_file(path, limit=MAX_FILE_BYTES, error=MotionError)
        said = stated_in_comments(path)
        try:
            names, rate = [str(name) for name in said["columns"]], float(said["rate_hz"])
            with warnings.catch_warnings():
                # Of a file without rows, which the number of columns tells as well.
                warnings.simplefilter("ignore", UserWarning)
                rows = np.loadtxt(path, ndmin=2)
        except (KeyError, TypeError, *DAMAGED) as error:
            raise unreadable(path, error) from error
        if rows.shape[1] != len(names) or rate <= 0.0:
            raise MotionError(
                f"has {rows.shape[1]} columns, and names {len(names)}", source=path, remedy="export it again"
            )
        columns = {name: rows[:, i] for i, name in enumerate(names)}
        return RawMotion({"time": np.arange(len(rows)) / rate, **columns}, of_robot(said))
