"""The commands that make logs and examine them, from ``capture`` and ``simulate`` to ``convert`` and ``doctor``."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

import excite
from excite.atomic import atomic_folder, write_text
from excite.cli.options import (
    Call,
    named_numbers,
    register_command,
)
from excite.cli.output import (
    EXIT_NEGATIVE,
    campaign_of,
    command_line,
    log_folder,
    progress_bars,
    stated_origin,
)
from excite.display import count
from excite.errors import InputError
from excite.results import write_json
from excite.robot.catalogue import is_robot, robot_of_log

if TYPE_CHECKING:
    from excite.conversion.result import Conversion


@register_command("capture")
def write_sheet(
    robot: str,
    plan: Path | None = None,
    purpose: str | None = None,
    out: Path | None = None,
    *,
    call: Call,
) -> None:
    """Write the sheet for the minutes at the robot: order of motions, repeats, what to record and to check."""
    from excite.campaign.capture import capture_policy  # lazy: pinocchio
    from excite.export.export import robot_beside  # lazy: pinocchio

    if (plan is None, purpose) not in ((False, None), (True, "policy")):
        raise InputError("needs a plan or --for policy, not both", field="plan", remedy="name one of them")
    # A plan for a model of one's own kept its robot, which then has a name and no file of this one.
    whose = robot if plan is None or Path(robot).exists() else robot_beside(plan / "plan.json", robot)
    # The sheet is read in another folder, and on another day.
    named = str(Path(whose).resolve()) if Path(whose).exists() else whose
    then: list[object] = ["convert", "RECORDING", "--robot", whose, "--out"]
    if plan is None:
        sheet, what = (
            capture_policy(excite.load_robot(whose), out, named=named),
            "two minutes of the policy's walk",
        )
        then += ["log"]
    else:
        sheet = excite.capture(excite.load_robot(whose), plan, out, named=named)
        minutes = sum(run.duration_s for run in sheet.capture.runs) / 60.0
        what = f"{count(len(sheet.capture.logged), 'recording')}, {minutes:.0f} minutes with warm-up"
        then += [log_folder(plan), "--capture", sheet.path]
    document = {"file": str(sheet.path), **sheet.capture.model_dump(mode="json", by_alias=True)}
    call.emit_result(f"wrote {sheet.path}: {what}", document, then=command_line(*then))


@register_command("simulate", cluster=True)
def simulate_motions(
    robot: str,
    motions: list[Path],
    inject: list[str] | None = None,
    nominal: bool = False,
    *,
    call: Call,
) -> None:
    """Run motions on a virtual robot whose true inertials differ from the model; writes a log folder."""
    from excite.campaign.experiment import planned_roles  # lazy: pydantic
    from excite.logs.files import check_replaceable  # lazy: pinocchio

    check_replaceable(call.out or Path("log"))
    loaded = excite.load_robot(robot)
    with call.working_in("log") as (folder, crew, progress):
        moves, planned = excite.load_motions(motions, loaded), planned_roles(motions)
        # Some of a plan's motions are run without the others; those that judge, alone, have to be learnt from.
        roles = {move.name: planned[move.name] for move in moves if move.name in planned}
        judged = all(roles.get(move.name) == "validation" for move in moves)
        experiment = excite.simulate(
            loaded,
            moves,
            inject=tuple(inject or ()),
            nominal=nominal,
            roles=None if judged else roles,
            seed=call.seed,
            jobs=crew,
            progress=progress,
        )
        experiment.save(folder)
    identify = command_line("identify", robot, folder, "--out", "result")
    then = command_line("diagnose", folder, "--out", "diagnosis") if inject else identify
    call.emit_result(
        f"{experiment.summary()}\nwritten to {folder}",
        experiment.to_json(),
        then=then,
    )
    if experiment.fell:
        raise typer.Exit(EXIT_NEGATIVE)


@register_command("init-log", out=False)
def write_log_header(
    folder: Path,
    force: bool = False,
    *,
    call: Call,
) -> None:
    """Write a commented log.yaml beside trial files: what they tell, and what a person must fill in."""
    written = excite.write_header(folder, overwrite=force)
    document = {"schema": "excite.init-log/1", "file": str(written.path), "fill_in": list(written.fill_in)}
    lines = [f"wrote {written.path}", *(f"  fill in: {mark}" for mark in written.fill_in)]
    call.emit_result("\n".join(lines), document, then=command_line("doctor", folder))


@register_command("convert")
def convert_recordings(
    sources: list[Path],
    robot: str,
    out: Path,
    mapping: Path | None = None,
    capture: Path | None = None,
    *,
    call: Call,
) -> None:
    """Make a log folder of any recording: columns, units and trials are found, and what was guessed is said."""
    found = excite.convert(sources, robot, out, mapping, capture)
    if not call.as_json:
        _show_guesses(found)
    then = _next_of_conversion(found, robot)
    call.emit_result(found.summary(), found.to_json(), then=then)


def _next_of_conversion(found: Conversion, robot: str) -> str:
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


@register_command("doctor")
def examine_log(
    log: Path,
    robot: str | None = None,
    repair: Path | None = None,
    *,
    call: Call,
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
            _examine_robot(log, call)
        else:
            _examine_episodes(log, call)
        return
    from excite.doctor.examine import doctor  # lazy: pinocchio
    from excite.logs.files import load_log  # lazy: pinocchio
    from excite.logs.robot import nominal_robot  # lazy: pinocchio

    model = None if robot is None else excite.robot_for_log(robot, log)
    loaded = load_log(log, model)
    nominal = model or nominal_robot(loaded)
    chart = doctor(loaded, nominal, repair=repair)
    document = chart.to_json()
    if call.out is not None:
        document |= stated_origin(robot or "", log, call.out)
        call.write_document(document, "doctor.json")
    if chart.usable:
        own = robot_of_log(chart.robot, chart.log.header.robot, log)
        then = command_line("identify", robot or own, repair or log, "--out", "result")
        if not chart.log.header.measures_forces:
            then = command_line("diagnose", repair or log, "--out", "diagnosis")
        call.emit_result(chart.summary(), document, then=then)
    chart.check_usable()


def _is_of_episodes(path: Path) -> bool:
    if not path.is_dir() or (path / "log.yaml").is_file():
        return False
    from excite.conversion.episodes import is_of_episodes  # lazy: pinocchio

    return is_of_episodes(path)


def _examine_episodes(folder: Path, call: Call) -> None:
    from excite.conversion.episodes import examine_episodes  # lazy: pinocchio
    from excite.report.plots.curves import save_drift  # lazy: numpy

    with call.requested_workers() as crew, progress_bars() as progress:
        chart = examine_episodes(folder, jobs=crew, progress=progress)
    document, summary = chart.to_json(), chart.summary()
    if call.out is not None:
        call.write_document(document, "doctor.json")
        write_text(call.out / "episodes.csv", chart.to_csv())
        summary += f"\ndrift: {save_drift(document['episodes'], call.out / 'drift.png')}"
    call.emit_result(summary, document)
    if not chart.healthy:
        raise typer.Exit(EXIT_NEGATIVE)


def _examine_robot(robot: Path, call: Call) -> None:
    from excite.robot.inspection.chart import examine_description  # lazy: pinocchio

    chart = examine_description(robot)
    document = chart.to_json()
    if call.out is not None:
        call.write_document(document | stated_origin(str(robot), None, call.out), "doctor.json")
    then = command_line("plan", robot) if chart.healthy else ""
    call.emit_result(chart.summary(), document, then=then)


_DOCUMENT = "human.json"


@register_command("human")
def measure_person(
    trials: list[Path],
    mass: float,
    height: float,
    sex: str,
    out: Path = Path("human_log"),
    static: list[Path] | None = None,
    table: str = "de_leva",
    markers: str | None = None,
    up: str | None = None,
    cutoff_hz: float = 6.0,
    hold_out: float = 0.3,
    segment_mass: list[str] | None = None,
    osim: str | None = None,
    *,
    call: Call,
) -> None:
    """Make a person's model (15 segments, 34 joints) and a log folder; then `excite identify DIR/robot.yaml DIR`."""
    settings = excite.MeasureSettings(
        table=table,
        markers=markers,
        up=up,
        cutoff_hz=cutoff_hz,
        hold_out=hold_out,
        segment_mass=named_numbers("--segment-mass", segment_mass),
        osim=osim,
    )
    subject = excite.Subject(mass, height, sex)
    from excite.logs.files import check_replaceable, keep_others  # lazy: pinocchio

    check_replaceable(out)
    written_before = _written_files(out)
    with progress_bars() as progress:
        person = excite.measure_person(subject, trials, tuple(static or ()), settings, progress)
    # All of it or nothing: a folder without what was asked for would be taken for the whole.
    with atomic_folder(out) as folder:
        excite.write_person(person, folder)
        files = sorted([_DOCUMENT, *(item.name for item in folder.iterdir())])
        document = replace(person, files=tuple(files)).to_json()
        write_json(document, folder / _DOCUMENT)
        keep_others(out, folder, written_before)
    then = command_line("identify", out / "robot.yaml", out, "--out", "segments")
    call.emit_result(f"{person.summary()}\nwrote {out}", document, then=then)


def _written_files(out: Path) -> list[str]:
    """Names of the files that an earlier run wrote into the folder, which this one replaces."""
    if not (out / _DOCUMENT).is_file():
        return []
    from excite.documents.document import model_of, read_document  # lazy: pydantic
    from excite.human.measure import MeasuredPerson  # lazy: pinocchio

    try:
        return list(read_document(out / _DOCUMENT, model_of(MeasuredPerson)).content()["files"])
    except InputError:  # what it named cannot be told: all is kept
        return []
