"""``make mutation``: the share of a random sample of mutants that the tests kill, and those that they do not.

The operators are Cosmic Ray's. The sample is drawn from all packages together, or from those that are named; the same
seed draws the same one. Results are appended to ``--out`` as they come, and what stands there already is not judged
again. Fails where the share is below the bar.
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
_SHOWN = "tests/test_dataclasses.py"
PACKAGES = {
    "excite/safety": ["tests/safety", _SHOWN],
    "excite/identification/estimators": ["tests/identification", _SHOWN],
    "excite/regressor": ["tests/regressor", "tests/identification", _SHOWN],
    "excite/motion": ["tests/motion", "tests/excitation", _SHOWN],
    "excite/rows": ["tests/identification", "tests/logs", _SHOWN],
    "excite/doctor": ["tests/doctor", _SHOWN],
    "excite/human": ["tests/human", _SHOWN],
    "excite/export": ["tests/export", _SHOWN],
    "excite/diagnosis/effects": ["tests/diagnosis", "tests/simulation", _SHOWN],
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
    """Judge a sample; 1 if the share is below the bar."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument(
        "--python", type=Path, default=Path(sys.executable), help="interpreter with excite's needs"
    )
    parser.add_argument(
        "--package", choices=PACKAGES, action="append", help="of these alone (may be repeated)"
    )
    parser.add_argument("--sample", type=int, default=200, help="mutants, of all packages together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="folder of the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    packages, killed, lines = options.package or list(PACKAGES), 0, []
    with tempfile.TemporaryDirectory(prefix="excite_mutation_") as folder:
        bench = Bench.make(ROOT, Path(folder), options.python)
        mutants = sample(bench.root, packages, options.sample, options.seed)
        for package in packages:
            own = [mutant for mutant in mutants if mutant.path.startswith(f"{package}/")]
            if not own:
                continue
            name = f"{package.replace('/', '.')}-{options.seed}.jsonl"
            results = judged(bench, bench.reach(PACKAGES[package]), own, options.out / name)
            here = sum(result.killed for _, result in results)
            killed += here
            lines.append(f"{package}: {here} of {len(own)}")
            lines += [
                f"  {result.outcome}: {mutant.path}:{mutant.line}: {mutant.change(bench.root)}"
                for mutant, result in results
                if not result.killed
            ]
    share = killed / len(mutants)
    print("\n".join(lines))
    print(f"{share:.1%} of {len(mutants)} mutants killed (bar {BAR:.0%}, seed {options.seed})")
    return int(share < BAR)


if __name__ == "__main__":
    sys.exit(main())
