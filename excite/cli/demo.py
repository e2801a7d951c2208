"""``excite demo``: the main job on a bundled robot, ending in a report."""

from __future__ import annotations

from pathlib import Path

import excite
from excite.claim import claimed
from excite.cli.options import DEFAULT_JOBS, JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.output import emit, progress_bars

NAME = "demo"


def command(
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Plan, check, run and identify on a virtual Unitree G1 with 5 kg added; ends in a report."""
    with claimed(out or Path("demo")) as folder, progress_bars() as progress:
        result = excite.demo(folder, seed=seed, jobs=jobs, progress=progress)
    emit(result.summary(), result.to_json(), as_json=as_json)
