"""``make bench``: measure the figures of the short parts, print them, and fail where a bar is missed.

``--all`` measures the long parts too (hours), ``--only NAME`` one part, ``--cheap`` those that took less than three
minutes of a processor when they were last measured. ``--stale`` leaves out parts whose code is as it was then.
``--write`` keeps what was measured in ``docs/measured.json``, part by part with its date, commit and machine, and
writes ``docs/measured.md`` from it. ``--page`` writes the page alone: parts whose code has changed since they were
measured are marked as stale on it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

from tests.benchmarks.freshness import Measurement, code_hash, measurement
from tests.benchmarks.table import Row, markdown

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
KEPT, PAGE = ROOT / "docs" / "measured.json", ROOT / "docs" / "measured.md"
# What ``--cheap`` measures took no more of a processor, children included [s].
CHEAP_S = 180.0
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
`--only NAME --write` one part of it, `--cheap --stale --write` the parts that take minutes and whose code has changed.
Under each part: when it was measured, of which commit, on which machine. A part is **stale** where the code that it
runs through, or its benchmark, changed since: its figures are of the commit.
"""


def parts() -> list[str]:
    """Modules of this package that measure something: those that define ``rows()``; the short ones first."""
    names = {path.stem for path in HERE.glob("*.py") if "\ndef rows()" in path.read_text(encoding="utf-8")}
    return [*SHORT, *sorted(names - set(SHORT))]


def main() -> int:
    """Run the parts asked for; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--only", choices=parts(), action="append", help="run this part (may be repeated)")
    parser.add_argument("--all", action="store_true", help="run the long parts too")
    parser.add_argument("--cheap", action="store_true", help=f"run what takes less than {CHEAP_S:g} s")
    parser.add_argument("--stale", action="store_true", help="of these, what is not of today's code")
    parser.add_argument("--write", action="store_true", help="keep the figures and write the page")
    parser.add_argument(
        "--page", action="store_true", help="write the page from what is kept; measure nothing"
    )
    arguments = parser.parse_args()
    if arguments.page:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    rows: list[Row] = []
    names = cheap_parts() if arguments.cheap else parts() if arguments.all else SHORT
    for name in arguments.only or names:
        if arguments.stale and not is_stale(name):
            continue
        print(f"measuring {name} …", file=sys.stderr, flush=True)
        before = _processor_s()
        found = importlib.import_module(f"tests.benchmarks.{name}").rows()
        seconds = _processor_s() - before
        print(f"{name} took {seconds:.0f} s of a processor", file=sys.stderr, flush=True)
        if arguments.write:
            keep(name, found, seconds)
        rows += found
    print(markdown(rows))
    return int(any(row.met is False for row in rows))


def cheap_parts() -> list[str]:
    """Parts that took less than :data:`CHEAP_S` when they were last measured; of those never timed, the short ones."""
    kept = _kept()
    seconds = {name: kept[name]["measured"].get("processor_s") for name in kept}
    untimed = {name: 0.0 if name in SHORT else CHEAP_S for name in parts() if seconds.get(name) is None}
    return [name for name in parts() if {**seconds, **untimed}[name] < CHEAP_S]


def is_stale(name: str) -> bool:
    """Whether a part was never measured, or its code has changed since."""
    kept = _kept()
    return name not in kept or kept[name]["measured"]["code"] != code_hash(name)


def _processor_s() -> float:
    return sum(os.times()[:4])


def keep(name: str, rows: list[Row], seconds: float) -> None:
    """Replace what is kept of one part, and write the page."""
    kept = _kept()
    kept[name] = {"measured": asdict(measurement(name, seconds)), "rows": [asdict(row) for row in rows]}
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
    stale = " **Stale**: the code has changed since." if is_stale(part) else ""
    return f"## {part}\n\n{measured.sentence()}{stale}\n\n{markdown(rows)}\n"


def _kept() -> dict:
    return json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else {}


if __name__ == "__main__":
    sys.exit(main())
