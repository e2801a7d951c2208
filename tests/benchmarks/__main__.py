"""``make bench``: measure every figure in the README's table, print it, and fail where a bar is missed.

``--write`` puts the table into README.md between its markers; ``--only NAME`` runs one part.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import re
import sys
from pathlib import Path

import tests.benchmarks
from tests.benchmarks.table import Row, markdown

README = Path(__file__).resolve().parents[2] / "README.md"
BEGIN, END = "<!-- bench -->", "<!-- /bench -->"


def parts() -> list[str]:
    """Modules of this package that measure something: those that define ``rows()``."""
    names = sorted(module.name for module in pkgutil.iter_modules(tests.benchmarks.__path__))
    return [name for name in names if name not in {"table", "__main__"} and not name.startswith("test_")]


def main() -> int:
    """Run the parts asked for; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="run this part (may be repeated)")
    parser.add_argument("--write", action="store_true", help="put the table into README.md")
    arguments = parser.parse_args()
    rows: list[Row] = []
    for name in arguments.only or parts():
        print(f"measuring {name} …", file=sys.stderr, flush=True)
        rows += importlib.import_module(f"tests.benchmarks.{name}").rows()
    table = markdown(rows)
    print(table)
    if arguments.write:
        text = README.read_text(encoding="utf-8")
        block = f"{BEGIN}\n{table}\n{END}"
        README.write_text(re.sub(f"{BEGIN}.*?{END}", lambda _: block, text, flags=re.S), encoding="utf-8")
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
