"""``excite diagnose``: where the simulator differs from the robot."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.cli.session.options import ApplyOption, JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import command_line, emit_result, progress_bars, stated_origin
from excite.errors import RobotError
from excite.results import write_json

if TYPE_CHECKING:
    from excite.diagnosis.answer.answer import Diagnosis
    from excite.robot.robot import Robot

NAME = "diagnose"


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log folder (excite.log/1).")],
    budget: Annotated[
        bool,
        typer.Option("--budget/--no-budget", help="Whether the answer holds where each joint's gap goes."),
    ] = True,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="The nominal robot, where it is not the one that the log names: bundled, a robot.yaml or a URDF.",
        ),
    ] = None,
    apply: ApplyOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Diagnose the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    nominal = None if robot is None else excite.robot_for_log(robot, log)
    model = None if apply is None else _check_nominal(nominal, log)
    with progress_bars() as progress:
        result = excite.diagnose(log, nominal, seed=seed, out=out or apply, budget=budget, progress=progress)
    summary, document = result.summary(), result.to_json()
    if apply is not None and model is not None:
        from excite.campaign.applied import apply_effects  # lazy: pinocchio

        try:
            applied = apply_effects(result, model, apply)
        except RobotError:
            if out is not None:
                # What was found is not lost with the robot that it does not make.
                _save_diagnosis(result, document | stated_origin(robot or "", log, out), out)
            raise
        summary += f"\n{applied.summary()}"
        beside = Path(os.path.relpath(applied.robot, out or Path.cwd()))
        document = replace(result, applied=replace(applied, robot=beside)).to_json()
    if out is not None:
        document |= stated_origin(robot or "", log, out)
        summary += f"\nreport: {_save_diagnosis(result, document, out)}"
    emit_result(summary, document, as_json=as_json, then=_next_command(robot, log, apply, document))


def _next_command(robot: str | None, log: Path, apply: Path | None, document: dict[str, Any]) -> str:
    """What to go on with: the effects written into the robot, the gap that is left with them, or nothing."""
    applied = document.get("applied")
    if applied is not None and applied["left_out"] and len(applied["left_out"]) >= len(document["effects"]):
        # A second diagnosis would say the same.
        return ""
    if apply is not None and document["verdict"] != "none":
        return command_line("diagnose", log, "--robot", apply / "robot.yaml", "--out", "second")
    if document["effects"]:
        return command_line("diagnose", log, "--apply", "better", "--out", "first")
    from excite.logs.header import header_path, read_header  # lazy: pydantic
    from excite.report.conclusions import identify_fitted  # lazy: pydantic

    words = identify_fitted(document, read_header(header_path(log)), robot, log)
    return command_line(*words) if words else ""


def _check_nominal(nominal: Robot | None, log: Path) -> Robot:
    """The robot that effects are to be written into, refused before any work where it takes none."""
    from excite.campaign.applied import check_applicable  # lazy: pinocchio
    from excite.logs.files import load_log  # lazy: pinocchio
    from excite.logs.robot import nominal_robot  # lazy: pinocchio

    robot = nominal or nominal_robot(load_log(log))
    check_applicable(robot)
    return robot


def _save_diagnosis(result: Diagnosis, document: dict[str, Any], out: Path) -> Path:
    """Write the curves, the document, and the page that shows both; returns the page."""
    from excite.report.comparisons import (  # lazy: numpy  # lazy: pydantic
        ForceComparison,
        PathComparison,
        ReportData,
        save_report_data,
    )

    c, rollouts = result.curves, result.simulation
    p = None if rollouts is None else rollouts.path
    data = ReportData(
        gap=None
        if c is None
        else ForceComparison(c.trial, c.channels, c.units, c.time, c.measured, c.before, c.after),
        path=None if p is None else PathComparison(p.trial, p.joints, p.time, p.recorded, p.before, p.after),
    )
    if data.gap is not None or data.path is not None:
        save_report_data(data, out / "report_data.npz")
    write_json(document, out / "diagnosis.json")
    return excite.report(out)
