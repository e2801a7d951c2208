"""``make check-properties``: drawn motions and limits, judged by the check and by a second judge.

Disagreements are printed with the number that draws them again; the exit code is 1 if there is any.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.properties.arms import draw_arm
from tests.properties.problems import draw_problem

N_ARMS = 24


def disagreements(seed: int, numbers: range, counts: Counter[str]) -> Iterator[str]:
    """What the check says otherwise, one line a problem; ``counts`` are added up in passing."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arms = [draw_arm(np.random.default_rng([seed, 1, k]), folder) for k in range(N_ARMS)]
        for number in numbers:
            problem = draw_problem(arms, seed, number, folder)
            said = problem.disagreement()
            counts[problem.kind] += 1
            counts["decided"] += problem.decided
            counts["unsafe"] += any(excess > 0.0 for excess in problem.beyond.values()) or bool(
                problem.certain
            )
            if said:
                yield f"seed {seed}, number {number}: {said}"


def main() -> int:
    """Judge as many problems as asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=150_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    counts, wrong = Counter[str](), 0
    for line in disagreements(asked.seed, range(asked.first, asked.first + asked.problems), counts):
        wrong += 1
        sys.stdout.write(line + "\n")
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    sys.stdout.write(f"{asked.problems} problems ({kinds}): {wrong} disagreements\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
