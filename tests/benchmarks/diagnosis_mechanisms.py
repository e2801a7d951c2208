"""Diagnosis of coupled and closed mechanisms: 33 drawn records with a seed used for nothing else."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from tests.benchmarks.mechanism_cases import EFFECTS, MACHINES, Case, drawn
from tests.benchmarks.table import Row

SEED = 90210


def rows() -> list[Row]:
    """Names, places and sizes by machine, and the time that a loop takes."""
    made: list[Row] = []
    for number, (name, make) in enumerate(MACHINES.items()):
        named, placed, seconds = [], [], []
        with tempfile.TemporaryDirectory() as folder:
            machine = make(Path(folder))
            for k, word in enumerate(EFFECTS):
                case = drawn(machine, word, np.random.default_rng([SEED, number, k]))
                started = time.process_time()
                found = diagnose(case.log, case.robot)
                seconds.append(time.process_time() - started)
                named.append(is_named(case, found))
                placed.append(is_placed(case, found))
        title = f"mechanisms, {name} ({len(EFFECTS)} records)"
        made += [
            Row.at_least(f"{title}: right name, firmly", 100.0 * float(np.mean(named)), 90.0, "%"),
            Row.at_least(f"{title}: right name and place", 100.0 * float(np.mean(placed)), 90.0, "%"),
            Row.at_most(f"{title}: processor time, median", median(seconds), 10.0, "s"),
        ]
    return made


def is_named(case: Case, found: Diagnosis) -> bool:
    """Whether the first effect has the right name and no other name stands beside it."""
    if case.effect == "none":
        return found.verdict == "none"
    return found.verdict == "effect" and found.effect == case.effect


def is_placed(case: Case, found: Diagnosis) -> bool:
    """Whether its place is right, too."""
    return is_named(case, found) and (case.effect == "none" or found.location == case.place)
