"""``excite doctor``: what is wrong with a log, and the log without it, or with a robot's description."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import command_line, emit_result, stated_origin
from excite.results import write_json
from excite.robot.catalogue import is_robot, robot_of_log

if TYPE_CHECKING:
    from excite.doctor.examine import Chart
    from excite.logs.log import Log
    from excite.robot.robot import Robot

NAME = "doctor"


def command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG|ROBOT",
            help="Log folder (excite.log/1); or a robot: bundled name, robot.yaml, URDF, xacro or MJCF.",
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option("--robot", metavar="ROBOT", help="The robot; by default the one that the log names."),
    ] = None,
    repair: Annotated[
        Path | None,
        typer.Option(
            "--repair", metavar="DIR", help="Write the log with what could be repaired to this folder."
        ),
    ] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Say what is wrong with a log, worst first: rows, clock, units, signs, order, zeros, dead channels.

    Of a robot say what is wrong with its description: masses, centres, inertias, limits, meshes.
    """
    if is_robot(log):
        if repair is not None or robot is not None:
            option = "--repair" if robot is None else "--robot"
            raise typer.BadParameter("is for a log; this is a robot", param_hint=f"'{option}'")
        _examine_robot(log, out, as_json=as_json)
        return
    from excite.doctor.doctor import doctor  # lazy: pinocchio
    from excite.logs.files import load_log  # lazy: pinocchio
    from excite.logs.robot import nominal_robot  # lazy: pinocchio

    model = None if robot is None else excite.robot_for_log(robot, log)
    loaded = load_log(log, model)
    nominal = model or nominal_robot(loaded)
    chart = doctor(loaded, nominal, repair=repair)
    document = chart.to_json()
    if out is not None:
        document |= stated_origin(robot or "", log, out)
        _save_findings(nominal, loaded, chart, document, out)
    if chart.usable:
        own = robot_of_log(chart.robot, chart.log.header.robot, log)
        then = command_line("identify", robot or own, repair or log, "--out", "result")
        if not chart.log.header.measures_forces:
            then = command_line("diagnose", repair or log, "--out", "diagnosis")
        emit_result(chart.summary(), document, as_json=as_json, then=then)
    chart.check_usable()


def _examine_robot(robot: Path, out: Path | None, *, as_json: bool) -> None:
    from excite.robot.inspection.chart import examine_description  # lazy: pinocchio

    chart = examine_description(robot)
    document = chart.to_json()
    if out is not None:
        write_json(document | stated_origin(str(robot), None, out), out / "doctor.json")
    then = command_line("plan", robot) if chart.healthy else ""
    emit_result(chart.summary(), document, as_json=as_json, then=then)


def _save_findings(robot: Robot, log: Log, chart: Chart, document: dict[str, Any], out: Path) -> None:
    """Write what was found, and the torques that a page of it shows."""
    from excite.doctor.model_comparison import beside_model  # lazy: pinocchio
    from excite.report.comparisons import (  # lazy: pydantic
        DOCTOR_DATA,
        ForceComparison,  # lazy: numpy
        ReportData,
        save_report_data,
    )

    seen = beside_model(robot, log, chart.log) if chart.usable else None
    shown = None
    if seen is not None:
        shown = ForceComparison(
            seen.trial, seen.joints, seen.units, seen.time, seen.model, seen.logged, seen.repaired
        )
    save_report_data(ReportData(torques=shown), out / DOCTOR_DATA)
    write_json(document, out / "doctor.json")
