"""Comma-separated values: a header line with names, then one line a sample."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import arrow_table
from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.export.statement import as_comments, motion_warnings
from excite.motion.content import motion_columns
from excite.motion.motion import Motion


class CsvExporter(Exporter):
    """Columns ``time`` [s], ``q.JOINT``, ``v.JOINT``, ``a.JOINT`` [SI]; where there are any,
    ``base.*`` and ``contact.*``. A motion that is not safe has its violations, and why it was written all the same, in
    lines above the names that start with ``#``.
    """

    name = "csv"
    suffix = ".csv"
    summary = "comma-separated columns time, q.JOINT, v.JOINT, a.JOINT (and base.*, contact.*)"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        options = pa.csv.WriteOptions(quoting_style="none")
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            stream.write(as_comments(motion_warnings(motion)).encode())
            pa.csv.write_csv(arrow_table(motion_columns(motion)), stream, options)
