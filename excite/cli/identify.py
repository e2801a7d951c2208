"""``excite identify``: inertial parameters from logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.atomic import all_or_nothing
from excite.cli.session.command_help import METHOD_HELP
from excite.cli.session.options import (
    AsymmetricOption,
    JobsOption,
    JsonOption,
    MassRangeOption,
    OutOption,
    RobotArgument,
    SeedOption,
    one_of,
    segment_settings,
)
from excite.cli.session.outcome import of_error
from excite.cli.session.output import command_line, emit_result, progress_bars, stated_origin
from excite.errors import InputError
from excite.identification.estimators.registry import DEFAULT_METHOD, ESTIMATORS
from excite.results import write_json

if TYPE_CHECKING:
    from excite.identification.sessions.compare import Sessions
    from excite.logs.signals.trace import SignalTrace

NAME = "identify"


def command(
    robot: RobotArgument,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Log folders (excite.log/1).")],
    method: Annotated[
        str, typer.Option("--method", help=METHOD_HELP, autocompletion=one_of(ESTIMATORS))
    ] = DEFAULT_METHOD,
    total_mass: Annotated[
        float | None, typer.Option("--total-mass", min=0.0, help="Weighed mass of the robot [kg].")
    ] = None,
    cutoff_hz: Annotated[
        float | None,
        typer.Option("--cutoff", min=0.0, help="Cut-off of the zero-phase low-pass on all signals [Hz]."),
    ] = None,
    bounds: Annotated[
        Path | None,
        typer.Option(
            "--bounds",
            metavar="FILE",
            help="Bounds of masses, centres of mass, inertias, drives (excite.physical_bounds/1), for physical, "
            "cls1, cls2, cls3.",
        ),
    ] = None,
    bounds_template: Annotated[
        Path | None,
        typer.Option(
            "--bounds-template",
            metavar="FILE",
            help="Write bounds of this robot to edit, and identify nothing.",
        ),
    ] = None,
    asymmetric: AsymmetricOption = None,
    mass_range: MassRangeOption = None,
    drives: Annotated[
        bool, typer.Option("--drives", help="Write identified friction into the model files too.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write a URDF even of parameters that no rigid body has.")
    ] = False,
    template: Annotated[
        Path | None,
        typer.Option(
            "--template",
            metavar="FILE",
            help="MuJoCo model of the robot: identified.xml is its text with the identified inertials.",
        ),
    ] = None,
    align: Annotated[
        bool, typer.Option("--align", help="Estimate how late torques were logged, and take it out.")
    ] = False,
    explain_signals: Annotated[
        bool,
        typer.Option("--explain-signals", help="Show what each step of the signal processing does."),
    ] = False,
    sessions: Annotated[
        bool,
        typer.Option(
            "--sessions",
            help="Also identify each session (as log.yaml names them, else each log) and pool them; "
            "with --out, ranges.yaml for domain randomisation.",
        ),
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Identify the inertial parameters: values, relative standard deviations, fit, validation.

    With --out also the robot's URDF and a MuJoCo model with the identified inertials, and differences.csv.
    """
    loaded = excite.robot_for_log(robot, logs[0])
    if bounds_template is not None:
        path = excite.write_bounds_template(loaded, bounds_template)
        then = command_line("identify", robot, *logs, "--method", "physical", "--bounds", path)
        emit_result(f"wrote {path}", {"bounds_template": str(path)}, as_json=as_json, then=then)
        return
    _check_template(loaded, template, out)
    stated = None if bounds is None else excite.load_bounds(bounds, loaded)
    read = [excite.load_log(log, loaded) for log in logs]
    log = excite.join_logs(read)
    settings = excite.ProblemSettings(cutoff_hz=cutoff_hz)
    lag = excite.estimate_torque_delay(loaded, log, settings) if align else None
    if lag is not None:
        settings = replace(settings, torque_delay_s=lag.lag_s)
    estimator = segment_settings(method, asymmetric, mass_range, total_mass=total_mass, bounds=stated)
    try:
        with progress_bars() as progress:
            result = excite.identify(
                loaded, log, method, settings=estimator, problem_settings=settings, progress=progress
            )
    except excite.NoSolutionError as error:
        if not isinstance(error.best, excite.Identification):
            raise
        _show_best(error, error.best, out, as_json=as_json)
        raise
    document, summary = result.to_json(), result.summary()
    if lag is not None:
        document["torque_delay"] = {"value_s": lag.lag_s, "std_s": lag.std_s}
        summary += f"\naligned: {lag.summary()}"
    pooled = _pool_sessions(loaded, read, settings) if sessions else None
    if pooled is not None:
        document["sessions"] = pooled.to_json()
        summary += f"\n\n{pooled.summary()}"
    trace = excite.explain_signals(loaded, log, settings) if explain_signals else None
    if trace is not None:
        document["signals"] = [{"step": step.name, "effect": step.effect} for step in trace.steps]
        summary += f"\n\n{trace.summary()}"
    if out is not None:
        with all_or_nothing():
            _write_extras(pooled, trace, out)
            excite.save_findings(loaded, result, log, out, settings)
            models = excite.write_models(loaded, result, out, drives=drives, force=force, template=template)
            document["models"] = models.to_json()
            summary = f"{summary}\n\n{models.summary()}"
            document |= stated_origin(robot, logs[0], out)
            write_json(document, out / "identification.json")
    then = (
        command_line("diagnose", logs[0], "--out", "diagnosis")
        if out is None
        else command_line("report", out)
    )
    emit_result(summary, document, as_json=as_json, then=then)


def _pool_sessions(robot: excite.Robot, logs: list[excite.Log], settings: excite.ProblemSettings) -> Sessions:
    return excite.identify_sessions(robot, excite.split_sessions(logs), problem_settings=settings)


def _write_extras(pooled: Sessions | None, trace: SignalTrace | None, out: Path) -> None:
    """Write what was asked for beside the identification."""
    if pooled is not None:
        excite.write_ranges(pooled, out / "ranges.yaml")
    if trace is not None:
        write_json(trace.to_json(), out / "signals.json")
        excite.save_signal_figure(trace, out / "signals.png")


def _check_template(robot: excite.Robot, template: Path | None, out: Path | None) -> None:
    """Say before the work is done that it could not be written."""
    if template is None:
        return
    if not template.is_file():
        raise InputError("is no file", source=template, remedy="give the MJCF file of the robot")
    if out is None:
        raise InputError("nothing to write into", source="--template", remedy="give --out DIR")
    from excite.export.models.mjcf_template import read_template  # lazy: pinocchio

    read_template(robot, template, {})


def _show_best(
    error: excite.NoSolutionError, best: excite.Identification, out: Path | None, *, as_json: bool
) -> None:
    """Show and write the best that is known, and say what it is; no model is made of it."""
    document = {**best.to_json(), "error": of_error(error).to_json()}
    if out is not None:
        write_json(document, out / "identification.json")
    emit_result(best.summary(), document, as_json=as_json)
    error.shown = True
