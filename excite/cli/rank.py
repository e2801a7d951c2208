"""``excite rank``: how well motions excite the inertial parameters."""

from __future__ import annotations

import excite
from excite.cli.session.options import (
    JobsOption,
    JsonOption,
    MotionArgument,
    OutOption,
    RobotArgument,
    SeedOption,
)
from excite.cli.session.output import command_line, emit_result, progress_bars
from excite.results import write_json

NAME = "rank"


def command(
    robot: RobotArgument,
    motions: MotionArgument,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Rank motions by condition numbers: full (base columns) and per segment."""
    loaded = excite.load_robot(robot)
    with progress_bars() as progress:
        ranking = excite.rank(loaded, excite.load_motions(motions, loaded), progress=progress)
    if out is not None:
        write_json(ranking.to_json(), out / "rank.json")
    emit_result(
        ranking.summary(),
        ranking.to_json(),
        as_json=as_json,
        then=command_line("export", *motions, "--robot", robot, "--format", "csv", "--out", "commands"),
    )
