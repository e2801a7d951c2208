"""Diagnoses of real robots: ``python -m tests.reproduction.real_robots [--only NAME] [--write]``.

Prints the page, or writes ``docs/real_robots.md`` and its pictures; fails where the diagnosis misses something that
is known from elsewhere. The recordings are looked for in ``$EXCITE_DATA``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from excite.atomic import write_text
from tests.reproduction.real_robots.collected import PARTS, collected
from tests.reproduction.real_robots.page import page
from tests.reproduction.real_robots.pictures import draw_pictures
from tests.reproduction.recordings_data import DATA

PAGE = Path(__file__).resolve().parents[3] / "docs" / "real_robots.md"


def main() -> int:
    """Print or write the page; 1 if something known is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.reproduction.real_robots", description=__doc__)
    parser.add_argument("--only", choices=tuple(PARTS), action="append", help="this part (may be repeated)")
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name}; needs all parts")
    given = parser.parse_args()
    if given.write and given.only:
        parser.error("the page needs all parts: leave out --only")
    if not DATA.is_dir():
        parser.error(f"recordings not found in {DATA}; set EXCITE_DATA")
    with tempfile.TemporaryDirectory() as name:
        entries = collected(DATA, Path(name), given.only or tuple(PARTS))
        if given.write:
            draw_pictures(DATA, Path(name) / "pictures", PAGE.parent / "images")
            write_text(PAGE, page(entries))
    if not given.write:
        print(page(entries))
    missed = [(e.title, bar) for e in entries for bar in e.bars if not bar.met]
    for title, bar in missed:
        print(f"missed: {title}: {bar.what}: {bar.reached}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
