"""``make mutation``: the share of a random sample of mutants that the tests kill, and those that they do not.

The operators are Cosmic Ray's. The same seed draws the same sample; results are appended to ``--out`` as they come,
and what stands there already is not judged again. Fails where a package's share is below the bar.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from tests.mutation.judge import Bench, Judgement, Reach
from tests.mutation.mutants import Mutant, sample

ROOT = Path(__file__).resolve().parents[2]
BAR = 0.85
# What is mutated, and where the tests are that a user of it relies on.
PACKAGES = {
    "excite/safety": ["tests/safety", "tests/test_dataclasses.py"],
    "excite/identification/estimators": ["tests/identification", "tests/test_dataclasses.py"],
}


def judged(bench: Bench, reach: Reach, mutants: list[Mutant], out: Path) -> list[tuple[Mutant, Judgement]]:
    """Judge mutants one after the other; those whose result stands in ``out`` are taken from there."""
    known: dict[Mutant, Judgement] = {}
    if out.is_file():
        for line in out.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            known[Mutant(**entry["mutant"])] = Judgement(**entry["judgement"])
    results = []
    for number, mutant in enumerate(mutants, 1):
        if mutant not in known:
            known[mutant] = bench.judge(mutant, reach)
            entry = {"mutant": asdict(mutant), "judgement": asdict(known[mutant])}
            with out.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({**entry, "change": mutant.change(bench.root)}) + "\n")
        result = known[mutant]
        print(
            f"{number}/{len(mutants)} {result.outcome} {mutant.path}:{mutant.line}",
            file=sys.stderr,
            flush=True,
        )
        results.append((mutant, result))
    return results


def main() -> int:
    """Judge a sample of each package; 1 if a share is below the bar."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument(
        "--python", type=Path, default=Path(sys.executable), help="interpreter with excite's needs"
    )
    parser.add_argument("--package", choices=PACKAGES, action="append", help="one of them (may be repeated)")
    parser.add_argument("--sample", type=int, default=120, help="mutants of each package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="folder of the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    missed = False
    for package in options.package or PACKAGES:
        with tempfile.TemporaryDirectory(prefix="excite_mutation_") as folder:
            bench = Bench.make(ROOT, Path(folder), options.python)
            reach = bench.reach(PACKAGES[package])
            mutants = sample(bench.root, package, options.sample, options.seed)
            name = f"{package.replace('/', '.')}-{options.seed}.jsonl"
            results = judged(bench, reach, mutants, options.out / name)
            share = sum(result.killed for _, result in results) / len(results)
            missed |= share < BAR
            print(
                f"\n{package}: {share:.1%} of {len(results)} mutants killed (bar {BAR:.0%}, seed {options.seed})"
            )
            for mutant, result in results:
                if not result.killed:
                    print(f"{result.outcome}: {mutant.path}:{mutant.line}: {mutant.change(bench.root)}")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
