"""``excite demo``: the main job on a bundled robot, ending in a report."""

from __future__ import annotations

from pathlib import Path

import excite
from excite.cli.session.options import (
    ClusterOption,
    JobsOption,
    JsonOption,
    OutOption,
    SeedOption,
    requested_workers,
)
from excite.cli.session.output import command_line, emit_result, progress_bars
from excite.folder_lock import claim_folder

NAME = "demo"


def command(
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Plan, check, run and identify on a virtual Unitree G1 with 5 kg added; ends in a report."""
    with (
        claim_folder(out or Path("demo")) as folder,
        requested_workers(jobs, cluster) as crew,
        progress_bars() as progress,
    ):
        result = excite.demo(folder, seed=seed, jobs=crew, progress=progress)
    emit_result(
        result.summary(),
        result.to_json(),
        as_json=as_json,
        then=command_line("plan", "ROBOT", "--out", "mine"),
    )
