"""``make bench``: measure every figure in the README's table, print it, and fail where a bar is missed.

``--all`` measures the long parts too (hours), ``--only NAME`` one part. ``--write`` keeps what was measured in
``docs/measured.json``, part by part, and rewrites the tables that are made of it: the README's, and
``docs/measured.md`` with all parts.
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import re
import sys
from dataclasses import asdict
from pathlib import Path

import tests.benchmarks
from tests.benchmarks.table import Row, markdown

ROOT = Path(__file__).resolve().parents[2]
README, KEPT, PAGE = ROOT / "README.md", ROOT / "docs" / "measured.json", ROOT / "docs" / "measured.md"
# Modules of this package that measure nothing themselves.
AIDS = {"table", "tree_memory", "constraint_cost", "foreign_robots", "__main__"}
BEGIN, END = "<!-- bench -->", "<!-- /bench -->"
# What the README shows, in its order; some twenty minutes on two cores.
SHOWN = (
    "main_job",
    "real_logs",
    "bad_motions",
    "planning_speed",
    "fourier_optimisation",
    "regressor_speed",
    "estimators",
    "identification_scale",
)


def parts() -> list[str]:
    """Modules of this package that measure something: those that define ``rows()``; the README's first."""
    names = {module.name for module in pkgutil.iter_modules(tests.benchmarks.__path__)}
    names = {name for name in names - AIDS if not name.startswith("test_")}
    return [*SHOWN, *sorted(names - set(SHOWN))]


def main() -> int:
    """Run the parts asked for; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="run this part (may be repeated)")
    parser.add_argument("--all", action="store_true", help="run the parts that are not in the README too")
    parser.add_argument("--write", action="store_true", help="keep the figures and rewrite the tables")
    arguments = parser.parse_args()
    rows: list[Row] = []
    for name in arguments.only or (parts() if arguments.all else SHOWN):
        print(f"measuring {name} …", file=sys.stderr, flush=True)
        found = importlib.import_module(f"tests.benchmarks.{name}").rows()
        if arguments.write:
            keep(name, found)
        rows += found
    print(markdown(rows))
    return int(any(row.met is False for row in rows))


def keep(name: str, rows: list[Row]) -> None:
    """Replace what is kept of one part, and rewrite the tables."""
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else {}
    kept[name] = [asdict(row) for row in rows]
    KEPT.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    tables = {part: markdown([Row(**row) for row in kept[part]]) for part in parts() if part in kept}
    text = README.read_text(encoding="utf-8")
    shown = markdown([Row(**row) for part in SHOWN if part in kept for row in kept[part]])
    block = f"{BEGIN}\n{shown}\n{END}"
    README.write_text(re.sub(f"{BEGIN}.*?{END}", lambda _: block, text, flags=re.S), encoding="utf-8")
    sections = [f"## {part}\n\n{table}\n" for part, table in tables.items()]
    head = "# Measured\n\n`python -m tests.benchmarks --all --write` makes this page.\n"
    PAGE.write_text("\n".join([head, *sections]), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
