"""``excite doctor``: what is wrong with a log, and the log without it, with a data set, or with a description."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.atomic import write_text
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption, requested_workers
from excite.cli.session.output import (
    EXIT_NEGATIVE,
    command_line,
    emit_result,
    progress_bars,
    stated_origin,
)
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
            metavar="LOG|DATASET|ROBOT",
            help="Log folder (excite.log/1); a data set of many episodes: LeRobot's, or a folder of bags or tables; or "
            "a robot: bundled name, robot.yaml, URDF, xacro or MJCF.",
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

    Of a robot say what is wrong with its description: masses, centres, inertias, limits, meshes. Of a data set say
    which episodes differ from the others, and in what; exit code 1 where one does.
    """
    of_robot = is_robot(log)
    if of_robot or _is_of_episodes(log):
        if repair is not None or robot is not None:
            option = "--repair" if robot is None else "--robot"
            what = "a robot" if of_robot else "a data set"
            raise typer.BadParameter(f"is for a log; this is {what}", param_hint=f"'{option}'")
        if of_robot:
            _examine_robot(log, out, as_json=as_json)
        else:
            _examine_episodes(log, out, jobs, as_json=as_json)
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


def _is_of_episodes(path: Path) -> bool:
    if not path.is_dir() or (path / "log.yaml").is_file():
        return False
    from excite.conversion.episodes import is_of_episodes  # lazy: pinocchio

    return is_of_episodes(path)


def _examine_episodes(folder: Path, out: Path | None, jobs: int | None, *, as_json: bool) -> None:
    from excite.conversion.episodes import examine_episodes  # lazy: pinocchio
    from excite.report.plots.drift import save_drift  # lazy: numpy

    with requested_workers(jobs, None) as crew, progress_bars() as progress:
        chart = examine_episodes(folder, jobs=crew, progress=progress)
    document, summary = chart.to_json(), chart.summary()
    if out is not None:
        write_json(document, out / "doctor.json")
        write_text(out / "episodes.csv", chart.to_csv())
        summary += f"\ndrift: {save_drift(document['episodes'], out / 'drift.png')}"
    emit_result(summary, document, as_json=as_json)
    if not chart.healthy:
        raise typer.Exit(EXIT_NEGATIVE)


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
