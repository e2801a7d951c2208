"""All entries of the page, part by part."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.reproduction.real_robots import arms, damper, dvrk, emps, small, so101, ur10e
from tests.reproduction.real_robots.entry import Entry

PARTS: dict[str, Callable[[Path, Path], list[Entry]]] = {
    "ur10e": ur10e.entries,
    "emps": emps.entries,
    "dvrk": dvrk.entries,
    "small": small.entries,
    "damper": damper.entries,
    "arms": arms.entries,
    "so101": so101.entries,
}


def collected(data: Path, folder: Path, parts: Sequence[str]) -> list[Entry]:
    """Entries of the parts asked for, in their order."""
    made: list[Entry] = []
    for name in parts:
        print(f"diagnosing {name} …", file=sys.stderr, flush=True)
        made += PARTS[name](data, folder / name)
    return made
