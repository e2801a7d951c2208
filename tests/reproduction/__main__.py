"""``make reproduce``: the papers' tables beside ours; fails where a bar is missed.

Every module of ``tests.reproduction.tables`` with ``tables()`` is asked; ``--only NAME`` asks one of them.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
import time

import tests.reproduction.tables
from tests.reproduction.table import Table


def parts() -> list[str]:
    """Modules that make tables."""
    return sorted(module.name for module in pkgutil.iter_modules(tests.reproduction.tables.__path__))


def main() -> int:
    """Print the tables asked for; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.reproduction", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="make this part's (may be repeated)")
    missed = 0
    for name in parser.parse_args().only or parts():
        start = time.perf_counter()
        print(f"reproducing {name} …", file=sys.stderr, flush=True)
        made: list[Table] = importlib.import_module(f"tests.reproduction.tables.{name}").tables()
        for table in made:
            print(table.markdown(), flush=True)
            missed += len(table.missed)
        print(f"{name}: {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
