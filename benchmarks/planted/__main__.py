"""Plant effects in recordings of real machines, diagnose the logs, and print how that went."""

from __future__ import annotations

import argparse
import tempfile
import time
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planted.machines import MACHINES, Machine
from benchmarks.planted.planting import TERM, Bench
from benchmarks.planted.score import Row, diagnosis_of, modelled_beside, save_log, score, table


def machine_rows(machine: Machine, effects: list[str], folder: Path, seed: int, draws: int) -> Iterator[Row]:
    """Rows of one machine; logs without the plant are diagnosed once for every baseline."""
    bench = Bench(machine)
    plain: dict[str | None, dict[str, Any]] = {}
    for name in (name for name in effects if name in bench.effects):
        clean, modelled = bench.without(TERM[name]), modelled_beside(name)
        if TERM[name] not in plain:
            log = save_log(folder / f"{machine.name}-without-{TERM[name]}", machine, clean, modelled)
            plain[TERM[name]] = diagnosis_of(log)
        for k in range(draws):
            # A case does not depend on which others are run.
            rng = np.random.default_rng([seed, k, zlib.crc32(f"{machine.name} {name}".encode())])
            effect = bench.draw(name, rng)
            planted = bench.plant(clean, effect)
            sight = bench.look(clean, planted, effect)
            log = save_log(folder / f"{machine.name}-{name}-{k}", machine, planted, modelled)
            start = time.perf_counter()
            document = diagnosis_of(log)
            yield score(bench, effect, sight, plain[TERM[name]], document, time.perf_counter() - start)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planted", description=__doc__)
    parser.add_argument("--machine", action="append", choices=[m.name for m in MACHINES])
    parser.add_argument("--effect", action="append", choices=list(TERM))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--draws", type=int, default=1, help="of each effect on each machine")
    parser.add_argument("--jobs", type=int, default=1, help="machines at a time")
    parser.add_argument("--out", type=Path, help="file for the table")
    given = parser.parse_args()
    chosen = [m for m in MACHINES if not given.machine or m.name in given.machine]
    rows: dict[str, list[Row]] = {machine.name: [] for machine in chosen}

    def text() -> str:
        return table([row for machine in chosen for row in rows[machine.name]])

    def fill(machine: Machine, folder: Path) -> None:
        if not machine.source.is_dir():
            print(f"{machine.name}: no recordings in {machine.source}; set EXCITE_DATA")
            return
        effects = given.effect or list(TERM)
        for row in machine_rows(machine, effects, folder, given.seed, given.draws):
            rows[machine.name].append(row)
            print(table([row]).splitlines()[2], flush=True)
            if given.out is not None:
                given.out.write_text(text())

    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(given.jobs) as pool:
        # Each has its result asked for: what goes wrong is raised.
        for done in [pool.submit(fill, machine, Path(name)) for machine in chosen]:
            done.result()
    print("\n" + text())


if __name__ == "__main__":
    main()
