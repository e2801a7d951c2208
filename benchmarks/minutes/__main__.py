"""Measure plans for minutes at the robot; ``--identified``: what two virtual robots' recordings of them tell.

``--settings``: what each setting of the gradient search is worth."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.minutes.identified import identify_designs
from benchmarks.minutes.measured import SECONDS, measure
from benchmarks.minutes.settings import compare_settings
from excite.robot.loading import load_robot


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as a table in Markdown."""
    head = list(rows[0])
    lines = [head, ["---"] * len(head), *([_word(row[name]) for name in head] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _word(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.minutes", description=__doc__)
    parser.add_argument("--robot", action="append", choices=list(SECONDS))
    parser.add_argument("--seed", action="append", type=int, help="0, 1 and 2 if none is given")
    parser.add_argument("--seconds", type=float, help="at the robot; those of its bar if none are given")
    parser.add_argument("--candidates", type=int, help="of the best three; a plan's own number if none")
    parser.add_argument("--jobs", type=int, default=1, help="processes of a plan")
    parser.add_argument(
        "--settings", action="store_true", help="change the search's settings one after the other"
    )
    parser.add_argument(
        "--identified", action="store_true", help="identify from the motions on two virtual robots"
    )
    parser.add_argument("--out", type=Path, help="file for the rows as JSON")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for robot in given.robot or (["ur10", "panda"] if given.settings else SECONDS):
        for seed in given.seed or ([0] if given.settings else [0, 1, 2]):
            found = (
                compare_settings(load_robot(robot), seed)
                if given.settings
                else identify_designs(robot, seed)
                if given.identified
                else measure(robot, seed, given.jobs, given.candidates, given.seconds)
            )
            for one in found:
                rows.append(one.row())
                print(table(rows[-1:]).splitlines()[-1], flush=True)
                if given.out is not None:
                    given.out.write_text(json.dumps(rows, indent=1) + "\n")
    print("\n" + table(rows))


if __name__ == "__main__":
    main()
