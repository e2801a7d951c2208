"""Where tables look for public recordings, and what they say where there are none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from tests.reproduction.table import Line, Table

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def from_recordings(title: str, make: Callable[[Path, Path], list[Table]]) -> list[Table]:
    """Tables that ``make`` finds in the recordings' folder, given a folder to work in; else one that says so."""
    if not DATA.is_dir():
        return [Table(title, (Line(f"recordings not found in {DATA}; set EXCITE_DATA", None, None),))]
    with tempfile.TemporaryDirectory() as name:
        return make(DATA, Path(name))
