"""The commands that make results of logs and that hand results on, from ``identify`` and ``diagnose`` to ``view``."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import excite
from excite.atomic import all_or_nothing
from excite.cli.options import Call, register_command, segment_settings
from excite.cli.outcome import of_error
from excite.cli.output import command_line, progress_bars, stated_origin
from excite.display import count
from excite.errors import InputError, RobotError
from excite.identification.estimators.registry import DEFAULT_METHOD
from excite.results import write_json

if TYPE_CHECKING:
    from excite.diagnosis.answer.answer import Diagnosis
    from excite.export.models.model_format import Lost
    from excite.export.models.simulator_model import SimulatorModel
    from excite.export.models.subject import Change
    from excite.robot.robot import Robot


@register_command("identify")
def identify_robot(
    robot: str,
    logs: list[Path],
    method: str = DEFAULT_METHOD,
    total_mass: float | None = None,
    cutoff_hz: float | None = None,
    bounds: Path | None = None,
    bounds_template: Path | None = None,
    asymmetric: list[str] | None = None,
    mass_range: list[str] | None = None,
    drives: bool = False,
    force: bool = False,
    template: Path | None = None,
    sessions: bool = False,
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
    pooled = (
        excite.identify_sessions(loaded, excite.split_sessions(read), problem_settings=settings)
        if sessions
        else None
    )
    if pooled is not None:
        document["sessions"] = pooled.to_json()
        summary += f"\n\n{pooled.summary()}"
    if call.out is not None:
        with all_or_nothing():
            if pooled is not None:
                excite.write_ranges(pooled, call.out / "ranges.yaml")
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


@register_command("identify-load")
def identify_load(
    robot: str,
    without: Path,
    loaded: Path,
    mass: float | None = None,
    calibration: Path | None = None,
    calibration_mass: float | None = None,
    cutoff_hz: float | None = None,
    controller: str | None = None,
    flange: str | None = None,
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


@register_command("diagnose")
def diagnose_log(
    log: Path,
    budget: bool = True,
    robot: str | None = None,
    apply: Path | None = None,
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
    # Those of a base that moves are written into no robot.
    writable = len(result.changes) > 1
    call.emit_result(summary, document, then=_next_of_diagnosis(robot, log, apply, document, writable))


def _next_of_diagnosis(
    robot: str | None, log: Path, apply: Path | None, document: dict[str, Any], writable: bool = True
) -> str:
    """What to go on with: the effects written into the robot, the gap that is left with them, or nothing."""
    applied = document.get("applied")
    if applied is not None and applied["left_out"] and len(applied["left_out"]) >= len(document["effects"]):
        # A second diagnosis would say the same.
        return ""
    if apply is not None and document["verdict"] != "none":
        return command_line("diagnose", log, "--robot", apply / "robot.yaml", "--out", "second")
    if writable:
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


@register_command("effects")
def list_effects(
    *,
    call: Call,
) -> None:
    """List the effects that a diagnosis can name: law, what looks like it, what tells them apart."""
    summaries = excite.effect_summaries()
    document = {"schema": "excite.effects/1", "effects": [summary.to_json() for summary in summaries]}
    call.write_document(document, "effects.json")
    lines: list[str] = []
    for base, title in {"fixed": "Arms", "floating": "Standing robots and people"}.items():
        lines.append(title)
        for one in (summary for summary in summaries if summary.base == base):
            lines.append(one.name + ("" if one.form == one.name else f" ({one.form.replace('_', ' ')})"))
            said = {"": one.law, "looks like: ": one.looks_like, "told apart by: ": one.told_apart_by}
            said["in MuJoCo: "] = one.mujoco
            lines += [f"    {label}{text}" for label, text in said.items() if text]
    call.emit_result("\n".join(lines), document, then=command_line("diagnose", "LOG", "--out", "diagnosis"))


# Results for controllers, simulators and people.

# Rows of the table on a terminal; changes.csv has all of them.
_MODEL_ROWS = 40
# Least width of that table [characters].
_MODEL_WIDTH = 110
# Smaller changes are no news [percent].
_NEWS = 0.1
# Order of what is shown, by the first letters of a parameter; what is not here comes first.
_RANK = {"com": 1, **dict.fromkeys(("Ixx", "Iyy", "Izz"), 2), **dict.fromkeys(("Ixy", "Ixz", "Iyz"), 3)}


@register_command("model")
def write_model(
    result: Path,
    format_name: str,
    out: Path,
    robot: str | None = None,
    template: Path | None = None,
    *,
    call: Call,
) -> None:
    """Write the identified robot for a simulator, with proof that each parameter arrives, and what is lost."""
    written = excite.write_simulator_model(result, format_name, out, robot=robot, template=template)
    main = written.folder / written.files[0]
    call.emit_result(
        "" if call.as_json else _describe_written(written),
        written.to_json(),
        then=f"open {main} in your simulator; {written.folder / 'changes.csv'} has all that changed",
    )


def _describe_written(written: SimulatorModel) -> str:
    from rich.console import Console
    from rich.table import Table

    # Names of joints are not cut: a line that is too long for a terminal is wrapped by it.
    console = Console(highlight=False, width=max(Console().width, _MODEL_WIDTH))
    shown = _shown_changes(written.changes)
    table = Table(
        "where", "parameter", *(f"{name}" for name in ("before", "after", "change", "unit")), box=None
    )
    for row in shown:
        table.add_row(
            row.place,
            row.parameter,
            f"{row.before:.4g}",
            f"{row.after:.4g}",
            f"{row.change:+.3g}{_relative_change(row)}",
            row.unit,
        )
    with console.capture() as capture:
        console.print(table)
    lines = [capture.get().rstrip()] if shown else []
    rest = sum(row.change != 0.0 for row in written.changes) - len(shown)
    if rest > 0:
        lines.append(f"and {count(rest, 'smaller change')}, in {written.folder / 'changes.csv'}")
    proof = written.proof
    lines += [f"wrote {written.folder / name}" for name in written.files]
    lines.append(
        f"read again: {proof.felt} parameters are as they were found, and so are the torques"
        + (f"; on {len(proof.unseen)} no torque depends" if proof.unseen else "")
    )
    lines += _describe_lost(written.lost)
    lines += [f"note: {text}" for text in written.notes]
    return "\n".join(lines)


def _shown_changes(changes: tuple[Change, ...]) -> list[Change]:
    """The rows that a person looks for first, in the model's order: masses and joints, then centres of mass."""
    news = [row for row in changes if 100.0 * abs(row.change) > _NEWS * _change_scale(row, changes)]
    kept = sorted(range(len(news)), key=lambda index: (_RANK.get(news[index].parameter[:3], 0), index))[
        :_MODEL_ROWS
    ]
    return [news[index] for index in sorted(kept)]


def _relative_change(row: Change) -> str:
    """The change in per cent; one that is larger than what was there is told by what was and is."""
    return "" if row.percent is None or abs(row.percent) > 100.0 else f" ({row.percent:+.1f} %)"


def _change_scale(row: Change, changes: tuple[Change, ...]) -> float:
    """What a change is seen beside: what was before, or where that was zero the body's other centres or inertias."""
    kind = next((kind for kind in ("com_", "I") if row.parameter.startswith(kind)), row.parameter)
    alike = (other for other in changes if other.place == row.place and other.parameter.startswith(kind))
    return abs(row.before) or max((abs(other.before) for other in alike), default=0.0)


def _describe_lost(lost: tuple[Lost, ...]) -> list[str]:
    """What is lost, a line for all places of a parameter together."""
    places: dict[tuple[str, str], list[str]] = {}
    for item in lost:
        value = "" if item.value is None else f" {item.value:.3g}"
        places.setdefault((item.parameter, item.why), []).append(f"{item.where}{value}")
    return [f"lost: {parameter} ({', '.join(where)}): {why}" for (parameter, why), where in places.items()]


@register_command("export")
def export_motions(
    motions: list[Path],
    format_name: str,
    rate_hz: float | None = None,
    robot: str | None = None,
    unsafe_anyway: str | None = None,
    approach: bool = False,
    settings: list[str] | None = None,
    *,
    call: Call,
) -> None:
    """Write motions in the format of a controller, if the independent check finds all of them safe."""
    from excite.export.export import export_with_verdicts, robot_beside  # lazy: pinocchio
    from excite.motion.collection import motion_paths  # lazy: pinocchio

    try:
        report = export_with_verdicts(
            motions,
            format_name,
            out=call.out or Path(),
            rate_hz=rate_hz,
            robot=robot,
            unsafe_anyway=unsafe_anyway,
            approach=approach,
            settings=_parse_settings(settings or []),
        )
    except excite.UnsafeMotionError as error:
        # One line each; the last one, which says what to do, is the error's own.
        for verdict in error.verdicts[1:]:
            print(f"excite: {verdict.summary()}", file=sys.stderr)
        raise
    for item in report.motions:
        if item.reason is not None:
            print(f"excite: written all the same: {item.judged.summary()}", file=sys.stderr)
    document = report.to_json()
    call.write_document(document, "export.json")
    call.emit_result(
        "\n".join(f"wrote {item.path}" for item in report.motions),
        document,
        then="run them, record, and "
        + command_line(
            "convert",
            "RECORDING",
            "--robot",
            robot or robot_beside(motion_paths(motions)[0], report.motions[0].robot),
            "--out",
            "log",
        ),
    )


def _parse_settings(texts: list[str]) -> dict[str, str]:
    """Settings from texts ``NAME=VALUE``, each once."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or name.strip() in found:
            raise typer.BadParameter(f"{text!r} is no NAME=VALUE, or stands twice", param_hint="'--set'")
        found[name.strip()] = value
    return found


@register_command("report")
def write_report(
    folder: Path,
    *,
    call: Call,
) -> None:
    """Write report.html from what a folder holds."""
    path = excite.report(folder, out=call.out)
    document = {"schema": "excite.report/1", "file": str(path.relative_to(call.out) if call.out else path)}
    call.emit_result(f"wrote {path}", document, then="open it in a browser")


@register_command("view")
def view_motions(
    thing: Path,
    robot: str | None = None,
    record: Path | None = None,
    port: int = 8080,
    *,
    call: Call,
) -> None:
    """Watch it move, with the signals of a joint and its residuals beside it."""
    from excite.report.view import read_thing, record_page, serve_page  # lazy: pinocchio

    shown = read_thing(thing, robot)
    if record is not None:
        path = record_page(shown, record if call.out is None else call.out / record)
        document = {"schema": "excite.view/1", "file": str(record), "motions": len(shown.clips)}
        call.emit_result(f"wrote {path}", document, then="open it in a browser")
        return

    def announce_address(address: str) -> None:
        document = {"schema": "excite.view/1", "address": address, "motions": len(shown.clips)}
        call.emit_result(f"{shown.title}\nopen {address} in a browser; Ctrl-C ends it", document)

    serve_page(shown, port, announce_address)
