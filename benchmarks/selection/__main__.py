"""``python -m benchmarks.selection LOG… [--out FOLDER]``: diagnoses of arms by one selection over all effects.

The selection stands in for the package's own search, :func:`excite.diagnosis.budget.record.model_of_gap`; what is
read of its model, shares, verdict and document, is the package's. ``--out`` keeps the documents by the logs' names,
as :mod:`benchmarks.blind` scores them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np

import excite
from benchmarks.selection.found import found_of
from benchmarks.selection.turns import select
from excite.arrays import Array
from excite.diagnosis.budget.record import Found
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.standing_joints import stands_throughout

_SEARCH = "excite.diagnosis.arm.diagnose.model_of_gap"


def model_by_selection(
    full: Baseline, modelled: tuple[str, ...], effects: tuple[Effect, ...], floor: Array, sigma: Array | None
) -> Found:
    """What :func:`excite.diagnosis.budget.record.model_of_gap` returns, from the posterior over all effects."""
    samples = full.samples
    tau = samples.rows([trial.measured for trial in samples.trials])[samples.identification]
    scale = np.where(stands_throughout(samples), np.inf, np.maximum(tau.std(axis=0), 1e-9))
    selected = select(full, modelled, effects, floor, np.random.default_rng(0))
    return found_of(selected, full, modelled, floor, scale)


def main() -> int:
    """Diagnose the logs, one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.selection", description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, help="folder for the documents")
    given = parser.parse_args()
    for log in given.logs:
        started = time.process_time()
        with patch(_SEARCH, model_by_selection):
            diagnosis = excite.diagnose(log)
        took = time.process_time() - started
        sys.stdout.write(f"{log.name} ({took:.1f} s)\n{diagnosis.summary()}\n")
        if given.out is not None:
            given.out.mkdir(parents=True, exist_ok=True)
            (given.out / f"{log.name}.json").write_text(json.dumps(diagnosis.to_json()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
