"""``make reproduce``: the papers' tables beside ours, and a summary; fails where a bar is missed without a reason.

Every module of ``tests.reproduction.tables`` with ``tables()`` is asked; ``--only NAME`` asks one of them.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
import time

import tests.reproduction.tables
from tests.reproduction.table import Table, summary


def parts() -> list[str]:
    """Modules that make tables."""
    return sorted(module.name for module in pkgutil.iter_modules(tests.reproduction.tables.__path__))


def main() -> int:
    """Print the tables asked for and the summary; 1 if a bar is missed that is not known to be."""
    parser = argparse.ArgumentParser(prog="python -m tests.reproduction", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="make this part's (may be repeated)")
    tables: list[Table] = []
    began = time.process_time()
    for name in parser.parse_args().only or parts():
        start = time.process_time()
        print(f"reproducing {name} …", file=sys.stderr, flush=True)
        made: list[Table] = importlib.import_module(f"tests.reproduction.tables.{name}").tables()
        for table in made:
            print(table.markdown(), flush=True)
        tables += made
        print(f"{name}: {time.process_time() - start:.1f} s of CPU", file=sys.stderr, flush=True)
    print(summary(tables), flush=True)
    print(f"all: {time.process_time() - began:.1f} s of CPU", file=sys.stderr, flush=True)
    return int(any(table.missed for table in tables))


if __name__ == "__main__":
    sys.exit(main())
