"""Comma-separated values: a header line with names, then one line a sample."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from excite.arrow_columns import arrow_table
from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.motion.content import motion_columns
from excite.motion.motion import Motion
from excite.motion.readers.table import UNSAFE
from excite.safety.verdict import Violation


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
            for line in _warnings(motion):
                stream.write(f"# {UNSAFE}: {' '.join(line.split())}\n".encode())
            pa.csv.write_csv(arrow_table(motion_columns(motion)), stream, options)


def _warnings(motion: Motion) -> list[str]:
    """What whoever opens the file has to know; nothing of a motion that is safe."""
    verdict = motion.metadata.verdict or {}
    if "unsafe_anyway" not in verdict:
        return []
    said = [Violation(**item) for item in verdict["violations"]]
    return [f"written all the same, {verdict['unsafe_anyway']}", *map(str, said)]
