"""Diagnoses of real robots: what is known of each recording beside what the diagnosis says."""

from __future__ import annotations

from pathlib import Path

from tests.reproduction.real_robots.collected import PARTS, collected
from tests.reproduction.real_robots.entry import said
from tests.reproduction.recordings_data import from_recordings
from tests.reproduction.table import Line, Table

_TITLE = "Diagnoses of real robots"


def tables() -> list[Table]:
    """One line a fact that is known, and one a recording of which nothing is."""
    return from_recordings(_TITLE, _tables)


def _tables(data: Path, folder: Path) -> list[Table]:
    lines = []
    for entry in collected(data, folder, tuple(PARTS)):
        if not entry.bars:
            lines.append(Line(entry.title, None, said(entry.diagnosis)))
        for bar in entry.bars:
            lines.append(
                Line(f"{entry.title}: {bar.what}", None, bar.reached, bar.met, "as known", bar.reason)
            )
    note = "`docs/real_robots.md` has the diagnoses in full (`python -m tests.reproduction.real_robots --write`)."
    return [Table(_TITLE, tuple(lines), note)]
