"""Options that every command takes, declared once."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

RobotArgument = Annotated[
    str, typer.Argument(metavar="ROBOT", help="Bundled robot (see `excite robots`) or path to a robot.yaml.")
]
MotionArgument = Annotated[
    list[Path],
    typer.Argument(metavar="MOTION…", help="Motion files (.parquet, .csv, .npz) or folders of them."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]
JobsOption = Annotated[
    int, typer.Option("--jobs", min=1, help="Processes to use; the result does not depend on it.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder that results are written to.")
]

DEFAULT_JOBS = os.cpu_count() or 1
