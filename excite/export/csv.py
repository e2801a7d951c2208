"""Comma-separated values: a header line with names, then one line a sample."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import arrow_table
from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.motion.files import motion_columns
from excite.motion.motion import Motion


class CsvExporter(Exporter):
    """Columns ``time`` [s], ``q.JOINT``, ``v.JOINT``, ``a.JOINT`` [SI]; where there are any,
    ``base.*`` and ``contact.*``.
    """

    name = "csv"
    suffix = ".csv"
    summary = "comma-separated columns time, q.JOINT, v.JOINT, a.JOINT (and base.*, contact.*)"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        options = pa.csv.WriteOptions(quoting_style="none")
        with atomic_path(path) as temporary:
            pa.csv.write_csv(arrow_table(motion_columns(motion)), temporary, options)
