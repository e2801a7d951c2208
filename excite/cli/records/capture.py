"""``excite capture``: the sheet for the minutes at the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, RobotArgument, SeedOption
from excite.cli.session.output import command_line, emit_result, log_folder
from excite.display import count

NAME = "capture"


def command(
    robot: RobotArgument,
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Folder of a plan (plan.json and motions/).")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The sheet (.md or .html); PLAN/capture.md if left out."),
    ] = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write the sheet for the minutes at the robot: order of motions, repeats, what to record and to check."""
    from excite.export.export import robot_beside  # lazy: pinocchio

    # A plan for a model of one's own kept its robot, which then has a name and no file of this one.
    whose = robot if Path(robot).exists() else robot_beside(plan / "plan.json", robot)
    # The sheet is read in another folder, and on another day.
    named = str(Path(whose).resolve()) if Path(whose).exists() else whose
    sheet = excite.capture(excite.load_robot(whose), plan, out, named=named)
    document = {"file": str(sheet.path), **sheet.capture.model_dump(mode="json", by_alias=True)}
    minutes = sum(run.duration_s for run in sheet.capture.runs) / 60.0
    emit_result(
        f"wrote {sheet.path}: {count(len(sheet.capture.logged), 'recording')}, {minutes:.0f} minutes with warm-up",
        document,
        as_json=as_json,
        then=command_line(
            "convert", "RECORDING", "--robot", whose, "--out", log_folder(plan), "--capture", sheet.path
        ),
    )
