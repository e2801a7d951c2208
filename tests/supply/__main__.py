"""``make licences``: name, version and licence of all that excite and its tests need; fails where one is not known.

``run`` are those that a user installs, ``test`` those of the tests and of lint alone. Copyleft is ``strong`` (GPL) or
``weak`` (LGPL, MPL). Licences are those that the distributions state; what a wheel bundles may add others.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tests.supply.licences import Licence, licence_of
from tests.supply.needed import needed, stated

ROOT = Path(__file__).resolve().parents[2]


def table(licences: list[Licence], run: set[str]) -> str:
    """A Markdown table, one row a distribution."""
    rows = [("name", "version", "licence", "copyleft", "for")]
    rows += [
        (
            one.name,
            one.version,
            one.licence or "NOT KNOWN",
            one.copyleft,
            "run" if one.name in run else "test",
        )
        for one in licences
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    return "\n".join([lines[0], "| " + " | ".join("-" * width for width in widths) + " |", *lines[1:]])


def main(project_file: Path) -> int:
    """Print the table for a project; 1 if a licence is not known."""
    licences = [licence_of(name, found) for name, found in needed(stated(project_file)).items()]
    print(table(licences, set(needed(stated(project_file, ())))))
    unknown = [f"{one.name} {one.version}" for one in licences if not one.licence]
    if unknown:
        print(
            f"licence not known: {', '.join(unknown)}: read what it ships and add its sentence to"
            " tests/supply/licences.py",
            file=sys.stderr,
        )
    return int(bool(unknown))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "pyproject.toml"))
