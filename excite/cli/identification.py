"""The commands ``identify``, ``identify-load``, ``diagnose`` and ``effects``: what logs say of a robot."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import excite
from excite.atomic import all_or_nothing
from excite.cli.options import (
    ApplyOption,
    Call,
    command,
    segment_settings,
)
from excite.cli.outcome import of_error
from excite.cli.output import command_line, progress_bars, stated_origin
from excite.errors import InputError, RobotError
from excite.identification.estimators.registry import DEFAULT_METHOD
from excite.results import write_json

if TYPE_CHECKING:
    from excite.diagnosis.answer.answer import Diagnosis
    from excite.identification.sessions.compare import Sessions
    from excite.logs.signals.trace import SignalTrace
    from excite.robot.robot import Robot


@command("identify")
def identify_robot(
    robot: str,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Log folders (excite.log/1).")],
    method: str = DEFAULT_METHOD,
    total_mass: Annotated[
        float | None, typer.Option("--total-mass", min=0.0, help="Weighed mass of the robot [kg].")
    ] = None,
    cutoff_hz: float | None = None,
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
    asymmetric: list[str] | None = None,
    mass_range: list[str] | None = None,
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
    *,
    call: Call,
) -> None:
    """Identify the inertial parameters: values, relative standard deviations, fit, validation.

    With --out also the robot's URDF and a MuJoCo model with the identified inertials, and differences.csv.
    """
    loaded = excite.robot_for_log(robot, logs[0])
    if bounds_template is not None:
        path = excite.write_bounds_template(loaded, bounds_template)
        then = command_line("identify", robot, *logs, "--method", "physical", "--bounds", path)
        call.emit_result(f"wrote {path}", {"bounds_template": str(path)}, then=then)
        return
    _check_template(loaded, template, call.out)
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
        _show_best(error, error.best, call)
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
    if call.out is not None:
        with all_or_nothing():
            _write_extras(pooled, trace, call.out)
            excite.save_findings(loaded, result, log, call.out, settings)
            models = excite.write_models(
                loaded, result, call.out, drives=drives, force=force, template=template
            )
            document["models"] = models.to_json()
            summary = f"{summary}\n\n{models.summary()}"
            document |= stated_origin(robot, logs[0], call.out)
            call.write_document(document, "identification.json")
    then = (
        command_line("diagnose", logs[0], "--out", "diagnosis")
        if call.out is None
        else command_line("report", call.out)
    )
    call.emit_result(summary, document, then=then)


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
    from excite.export.models.mjcf import read_template  # lazy: pinocchio

    read_template(robot, template)


def _show_best(error: excite.NoSolutionError, best: excite.Identification, call: Call) -> None:
    """Show and write the best that is known, and say what it is; no model is made of it."""
    document = {**best.to_json(), "error": of_error(error).to_json()}
    call.write_document(document, "identification.json")
    call.emit_result(best.summary(), document)
    error.shown = True


@command("identify-load")
def identify_load(
    robot: str,
    without: Annotated[Path, typer.Argument(metavar="WITHOUT", help="Log folder of the bare robot.")],
    loaded: Annotated[Path, typer.Argument(metavar="LOADED", help="Log folder with the load.")],
    mass: Annotated[
        float | None, typer.Option("--mass", help="Mass of the load [kg], where a scale told it.")
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option("--calibration", metavar="LOG", help="Log folder with another load, of known mass."),
    ] = None,
    calibration_mass: Annotated[
        float | None, typer.Option("--calibration-mass", help="Mass of that other load [kg].")
    ] = None,
    cutoff_hz: float | None = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="MAKER",
            help="Write the load for an arm's controller: ur, franka, kuka, fanuc or abb.",
        ),
    ] = None,
    flange: Annotated[
        str | None,
        typer.Option(
            "--flange", metavar="FRAME", help="Frame of the description that is the maker's flange."
        ),
    ] = None,
    *,
    call: Call,
) -> None:
    """Identify a load on the last link: mass, first moments, inertia, with intervals, and the drives' gains.

    Mass and torque scales are known only together: state the mass (--mass), or calibrate the gains with another load
    (--calibration, --calibration-mass), or the log's torque constants are believed.
    """
    if (calibration is None) != (calibration_mass is None):
        raise InputError(
            "come together", source="--calibration, --calibration-mass", remedy="give both, or neither"
        )
    if controller is not None:
        from excite.export.payload import find_payload_format  # lazy: pinocchio

        find_payload_format(controller)
    model = excite.robot_for_log(robot, without)
    logs = [excite.load_log(folder, model) for folder in (without, loaded)]
    known = None
    if calibration is not None and calibration_mass is not None:
        known = (excite.load_log(calibration, model), calibration_mass)
    settings = excite.ProblemSettings(cutoff_hz=cutoff_hz)
    found = excite.weigh_load(model, *logs, mass=mass, calibration=known, settings=settings)
    document, summary = found.to_json(), found.summary()
    if controller is not None:
        from excite.export.payload import payload_for  # lazy: pinocchio

        payload = payload_for(found, model, controller, flange)
        document["controller"] = payload.to_json()
        summary += f"\n{payload.summary()}"
        if call.out is not None:
            payload.write(call.out)
    call.write_document(document, "load.json")
    call.emit_result(
        summary,
        document,
        then=command_line("diagnose", loaded, "--out", "diagnosis"),
    )


@command("diagnose")
def diagnose_log(
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
    *,
    call: Call,
) -> None:
    """Diagnose the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    nominal = None if robot is None else excite.robot_for_log(robot, log)
    model = None if apply is None else _check_nominal(nominal, log)
    with progress_bars() as progress:
        result = excite.diagnose(
            log, nominal, seed=call.seed, out=call.out or apply, budget=budget, progress=progress
        )
    summary, document = result.summary(), result.to_json()
    if apply is not None and model is not None:
        from excite.campaign.applied import apply_effects  # lazy: pinocchio

        try:
            applied = apply_effects(result, model, apply)
        except RobotError:
            if call.out is not None:
                # What was found is not lost with the robot that it does not make.
                _save_diagnosis(result, document | stated_origin(robot or "", log, call.out), call.out)
            raise
        summary += f"\n{applied.summary()}"
        beside = Path(os.path.relpath(applied.robot, call.out or Path.cwd()))
        document = replace(result, applied=replace(applied, robot=beside)).to_json()
    if call.out is not None:
        document |= stated_origin(robot or "", log, call.out)
        summary += f"\nreport: {_save_diagnosis(result, document, call.out)}"
    call.emit_result(summary, document, then=_next_of_diagnosis(robot, log, apply, document))


def _next_of_diagnosis(robot: str | None, log: Path, apply: Path | None, document: dict[str, Any]) -> str:
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
    from excite.report.comparisons import save_diagnosis_curves  # lazy: pydantic

    save_diagnosis_curves(result, out)
    write_json(document, out / "diagnosis.json")
    return excite.report(out)


@command("effects")
def list_effects(
    *,
    call: Call,
) -> None:
    """List the effects that a diagnosis can name: law, what looks like it, what tells them apart."""
    summaries = excite.effect_summaries()
    document = {"schema": "excite.effects/1", "effects": [summary.to_json() for summary in summaries]}
    if call.is_printed(document, "effects.json"):
        return
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console()
    titles = {"fixed": "Arms", "floating": "Standing robots and people"}
    for base, title in titles.items():
        console.print(Text(title, style="bold"))
        for summary in summaries:
            if summary.base == base:
                form = "" if summary.form == summary.name else f" ({summary.form.replace('_', ' ')})"
                console.print(Text(summary.name + form, style="cyan"))
                for text in (
                    summary.law,
                    f"looks like: {summary.looks_like}",
                    f"told apart by: {summary.told_apart_by}" if summary.told_apart_by else "",
                    f"in MuJoCo: {summary.mujoco}" if summary.mujoco else "",
                ):
                    if text:
                        console.print(Padding(Text(text), (0, 0, 0, 4), expand=False))
    print(f"then: {command_line('diagnose', 'LOG', '--out', 'diagnosis')}")
