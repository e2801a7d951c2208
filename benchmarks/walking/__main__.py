"""Draw faults of a robot that walks, diagnose the logs without being told, and print how many are named rightly."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import excite
from benchmarks.walking import steps, trot
from benchmarks.walking.servos import Case, Fallen, walk

SECONDS, TRIES = 13.0, 20
# By robot: its gait, and who draws what is wrong with it.
ROBOTS: dict[str, tuple[type[trot.Trot | steps.Steps], Callable[[int, np.random.Generator], Case]]] = {
    "go2": (trot.Trot, trot.draw_case),
    "g1_no_ft": (steps.Steps, steps.draw_case),
}


@dataclass(frozen=True)
class Row:
    """A case, what is said of it, and whether that is right.

    Attributes:
        number: of the case.
        truth: effect, place and size.
        said: verdict, effect, place and size of the first effect.
        placed: whether the place is right.
        right: whether effect and place are.
        firm_wrong: whether the verdict is firm and the first effect or its place wrong.
        besides: what is named that is not there.
        seconds: that the diagnosis took.
    """

    number: int
    truth: str
    said: str
    placed: bool
    right: bool
    firm_wrong: bool
    besides: str
    seconds: float


def run_case(name: str, seed: int, number: int) -> Row:
    """Draw, record and diagnose one case; of draws that fall the next one counts."""
    robot, (gait, draw_case) = excite.load_robot(name), ROBOTS[name]
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, number, attempt])
        case = draw_case(number, rng)
        rng = np.random.default_rng(int(rng.integers(2**31)))
        try:
            log = walk(gait(robot, SECONDS, rng), (case.fault,), rng)
        except Fallen:
            continue
        return _scored(number, case, log, name)
    raise Fallen(f"all draws of case {number}")


def _scored(number: int, case: Case, log: excite.Log, name: str) -> Row:
    start = time.perf_counter()
    found = excite.diagnose(log, excite.load_robot(name))
    true = {(effect, place) for effect in case.effects for place in case.places}
    first = (found.effect, found.location)
    placed = bool({*case.places} & {found.location, *found.tied_locations})
    right = placed and found.effect in case.effects
    size = (
        "" if not found.effects else " ".join(f"{v.value:.3g}" for v in found.effects[0].parameters.values())
    )
    besides = [
        f"{e.effect}@{e.location}" for e in found.effects if (e.effect, e.location) not in {*true, first}
    ]
    return Row(
        number,
        f"{case.effects[0]}@{case.places[0]} {case.size}",
        f"{found.verdict}: {first[0]}@{first[1]} {size}",
        placed,
        right,
        found.verdict == "effect" and not right,
        ", ".join(besides),
        time.perf_counter() - start,
    )


def table(rows: list[Row]) -> Iterator[str]:
    """Lines of a Markdown table, then the score beside its bars."""
    yield "| case | drawn | said | place | effect, place | named besides | s |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for row in sorted(rows, key=lambda row: row.number):
        marks = " | ".join("✓" if ok else "✗" for ok in (row.placed, row.right))
        yield f"| {row.number} | {row.truth} | {row.said} | {marks} | {row.besides or '–'} | {row.seconds:.0f} |"
    n = len(rows)
    figures = (
        ("right side and joint", sum(row.placed for row in rows), 0.90, True),
        ("right effect at the right place", sum(row.right for row in rows), 0.90, True),
        ("firm and wrong", sum(row.firm_wrong for row in rows), 0.01, False),
    )
    yield ""
    for name, count, bar, least in figures:
        met = count >= bar * n if least else count <= bar * n
        yield f"- {name}: {count} of {n}, bar {'≥' if least else '≤'} {100 * bar:.0f} % {'✓' if met else '✗'}"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walking", description=__doc__)
    parser.add_argument("--robot", choices=sorted(ROBOTS), default="go2")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, nargs="*", default=list(range(24)), help="numbers of the cases")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, help="file for the table")
    given = parser.parse_args()
    rows: list[Row] = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for done in as_completed(
            [pool.submit(run_case, given.robot, given.seed, number) for number in given.cases]
        ):
            rows.append(done.result())
            print(list(table(rows[-1:]))[2], flush=True)
    text = "\n".join(table(rows)) + "\n"
    print("\n" + text)
    if given.out is not None:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
