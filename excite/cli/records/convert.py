"""``excite convert``: any recording to a log folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, SeedOption
from excite.cli.session.output import campaign_of, command_line, emit_result

if TYPE_CHECKING:
    from excite.conversion.result import Conversion

NAME = "convert"


def command(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE…", help="Recordings: text tables, Parquet, npz, HDF5, JSON, .mat, bags, MCAP …"
        ),
    ],
    robot: Annotated[
        str,
        typer.Option(
            "--robot", metavar="ROBOT", help="Bundled robot, or path to a robot.yaml, URDF, xacro or MJCF."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="LOG", help="Log folder that is written.")],
    mapping: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="map.yaml that says what the recording does not tell."),
    ] = None,
    capture: Annotated[
        Path | None,
        typer.Option(
            "--capture", metavar="SHEET", help="Sheet of `excite capture` that the log is checked against."
        ),
    ] = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Make a log folder of any recording: columns, units and trials are found, and what was guessed is said."""
    found = excite.convert(sources, robot, out, mapping, capture)
    if not as_json:
        _show_guesses(found)
    then = _next_command(found, robot)
    emit_result(found.summary(), found.to_json(), as_json=as_json, then=then)


def _next_command(found: Conversion, robot: str) -> str:
    """What can be done with the log; where nothing can, motions to record what it lacks in, or nothing."""
    if found.chart is not None and not found.chart.usable:
        fatal = {f.kind for f in found.chart.findings if f.severity == "fatal" and not f.repaired}
        return command_line("plan", robot, "--out", "plan") if fatal == {"no_torques"} else ""
    campaign = campaign_of(found.folder)
    if campaign is not None:
        return command_line("campaign", robot, "--resume", "--out", campaign)
    if not found.log.header.measures_forces:
        return command_line("diagnose", found.folder, "--out", "diagnosis")
    return command_line("identify", robot, found.folder, "--out", "result")


def _show_guesses(found: Conversion) -> None:
    """The table of what was guessed, with reasons."""
    from rich.console import Console
    from rich.table import Table

    table = Table("what", "from", "because")
    for row in found.guesses:
        table.add_row(*row)
    for name, role, because in found.trials:
        table.add_row(f"trial {name}", role, because)
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else 160, markup=False).print(table)
