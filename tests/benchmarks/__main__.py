"""``make bench``: measure the figures of the short parts, print them, and fail where a bar is missed.

``--all`` measures the long parts too (hours), ``--only NAME`` one part. ``--write`` keeps what was measured in
``docs/measured.json``, part by part with its date, commit and machine, and writes ``docs/measured.md`` from it.
``--page`` writes the page alone: parts whose code has changed since they were measured are marked as stale on it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import sys
from dataclasses import asdict
from pathlib import Path

import tests.benchmarks
from tests.benchmarks.freshness import Measurement, code_hash, measurement
from tests.benchmarks.table import Row, markdown

ROOT = Path(__file__).resolve().parents[2]
KEPT, PAGE = ROOT / "docs" / "measured.json", ROOT / "docs" / "measured.md"
# Modules of this package that measure nothing themselves.
AIDS = {"table", "freshness", "tree_memory", "constraint_cost", "foreign_robots", "__main__"}
# What is measured without ``--all``, and first on the page; some twenty minutes on two cores.
SHORT = (
    "main_job",
    "real_logs",
    "bad_motions",
    "planning_speed",
    "fourier_optimisation",
    "regressor_speed",
    "estimators",
    "identification_scale",
)
HEAD = """# Measured

Every figure with its bar; a cross is a bar that is missed. `python -m tests.benchmarks --all --write` makes this page,
`--only NAME --write` one part of it. Under each part: when it was measured, of which commit, on which machine. A part
is **stale** where the code that it runs through, or its benchmark, changed since: its figures are of the commit.
"""


def parts() -> list[str]:
    """Modules of this package that measure something: those that define ``rows()``; the short ones first."""
    names = {module.name for module in pkgutil.iter_modules(tests.benchmarks.__path__)}
    names = {name for name in names - AIDS if not name.startswith("test_")}
    return [*SHORT, *sorted(names - set(SHORT))]


def main() -> int:
    """Run the parts asked for; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="run this part (may be repeated)")
    parser.add_argument("--all", action="store_true", help="run the long parts too")
    parser.add_argument("--write", action="store_true", help="keep the figures and write the page")
    parser.add_argument(
        "--page", action="store_true", help="write the page from what is kept; measure nothing"
    )
    arguments = parser.parse_args()
    if arguments.page:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    rows: list[Row] = []
    for name in arguments.only or (parts() if arguments.all else SHORT):
        print(f"measuring {name} …", file=sys.stderr, flush=True)
        found = importlib.import_module(f"tests.benchmarks.{name}").rows()
        if arguments.write:
            keep(name, found)
        rows += found
    print(markdown(rows))
    return int(any(row.met is False for row in rows))


def keep(name: str, rows: list[Row]) -> None:
    """Replace what is kept of one part, and write the page."""
    kept = _kept()
    kept[name] = {"measured": asdict(measurement(name)), "rows": [asdict(row) for row in rows]}
    KEPT.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """The page: every part with what it was measured on, and whether its code has changed since."""
    kept = _kept()
    sections = [_section(part, kept[part]) for part in parts() if part in kept]
    return "\n".join([HEAD, *sections])


def _section(part: str, kept: dict) -> str:
    measured = Measurement(**kept["measured"])
    rows = [Row(**row) for row in kept["rows"]]
    stale = "" if measured.code == code_hash(part) else " **Stale**: the code has changed since."
    return f"## {part}\n\n{measured.sentence()}{stale}\n\n{markdown(rows)}\n"


def _kept() -> dict:
    return json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else {}


if __name__ == "__main__":
    sys.exit(main())
