"""``excite check``: the independent verdict on motions."""

from __future__ import annotations

import typer

import excite
from excite.cli.options import (
    DEFAULT_JOBS,
    JobsOption,
    JsonOption,
    MotionArgument,
    OutOption,
    RobotArgument,
    SeedOption,
)
from excite.cli.output import EXIT_NEGATIVE, emit, progress_bars
from excite.json_document import write_json

NAME = "check"


def command(
    robot: RobotArgument,
    motions: MotionArgument,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Check motions independently: verdict, margins, first violation with time and place."""
    loaded = excite.load_robot(robot)
    with progress_bars() as progress:
        result = excite.check(loaded, excite.load_motions(motions, loaded), jobs=jobs, progress=progress)
    if out is not None:
        write_json(result.to_json(), out / "check.json")
    emit(result.summary(), result.to_json(), as_json=as_json)
    if not result.safe:
        raise typer.Exit(EXIT_NEGATIVE)
