"""Options that every command takes, declared once."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from excite.claim import claim_folder
from excite.cli.session.completion import complete_robots
from excite.errors import InputError
from excite.parallel.jobs import check_jobs


def _usable_folder(context: typer.Context, folder: Path | None) -> Path | None:
    """The folder of results, refused before any work is done for it, and kept for this run until it ends."""
    if folder is None:
        return None
    if "\0" in str(folder):
        raise InputError("has a name that no folder can have", field="--out", remedy="give another --out")
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.exists(path))
    if not there.is_dir():
        raise InputError("is a file, not a folder", source=there, remedy="give another --out")
    if not os.access(there, os.W_OK):
        raise InputError(
            "may not be written to", source=there, remedy="give another --out, or change its permissions"
        )
    context.with_resource(claim_folder(folder))
    return folder


def _possible_jobs(jobs: int | None) -> int | None:
    """The number of processes, refused where no machine runs as many."""
    if jobs is not None:
        try:
            check_jobs(jobs)
        except InputError as error:
            raise typer.BadParameter(f"{error.what}; {error.remedy}", param_hint="'--jobs'") from error
    return jobs


RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="Bundled robot (see `excite robots`), or path to a robot.yaml, URDF, xacro or MJCF.",
        autocompletion=complete_robots,
    ),
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
    int | None,
    typer.Option(
        "--jobs",
        help="Processes to use; the result does not depend on it.",
        show_default="up to one a core",
        callback=_possible_jobs,
    ),
]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="Dask scheduler whose workers are to be used instead, such as tcp://10.0.0.1:8786.",
    ),
]


def _named_arguments(context: typer.Context, given: list[str] | None) -> list[str] | None:
    for one in given or []:
        if ":=" not in one:
            raise typer.BadParameter(f"{one!r} is not name:=value", param_hint="'--xacro-arg'")
    return given


PackagePathOption = Annotated[
    list[Path] | None,
    typer.Option("--package-path", help="Folder of ROS packages of the robot's model (may be repeated)."),
]
XacroArgOption = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg",
        metavar="NAME:=VALUE",
        help="Argument of the robot's xacro file (may be repeated).",
        callback=_named_arguments,
    ),
]
LimitsOption = Annotated[
    Path | None,
    typer.Option(
        "--limits",
        metavar="FILE",
        help="Joint limits of the robot that hold where they are tighter, MoveIt's joint_limits.yaml.",
    ),
]
ApplyOption = Annotated[
    Path | None,
    typer.Option(
        "--apply",
        metavar="DIR",
        help="Write the robot with the effects found: robot.yaml and robot.urdf, for --robot of the next round.",
        callback=_usable_folder,
    ),
]
ModelOutOption = Annotated[
    Path,
    typer.Option(
        "--out", "-o", metavar="DIR", help="Folder that the model is written to.", callback=_usable_folder
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder that results are written to.", callback=_usable_folder),
]
