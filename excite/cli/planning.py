"""The commands on robots and on experiments with them, from ``robots`` and ``plan`` to ``campaign`` and ``demo``."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

import excite
from excite.cli.options import (
    Call,
    register_command,
    stated_source,
)
from excite.cli.outcome import exit_code_of_interruption, keeping_best, say_interrupted
from excite.cli.output import (
    EXIT_NEGATIVE,
    command_line,
    print_document,
    progress_bars,
    relative_to,
    stated_origin,
)
from excite.errors import NoSolutionError
from excite.identification.estimators.registry import DEFAULT_METHOD
from excite.provenance import made_by


@register_command("robots")
def list_robots(
    *,
    call: Call,
) -> None:
    """List the bundled robots: degrees of freedom, mass, sensors, base type."""
    summaries = excite.robot_summaries()
    document = {"schema": "excite.robots/1", "robots": [summary.to_json() for summary in summaries]}
    if call.is_printed(document, "robots.json"):
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("robot", "title", "base", "DoF", "mass [kg]", "sensors", box=None, pad_edge=False)
    for summary in summaries:
        table.add_row(
            summary.name,
            summary.title,
            summary.base,
            str(summary.n_joints),
            f"{summary.mass:.1f}",
            ", ".join(summary.sensors),
        )
    Console(soft_wrap=True).print(table)
    print(f"then: {command_line('plan', 'ROBOT', '--out', 'plan')}")


@register_command("init-robot")
def write_description(
    file: Path,
    srdf: Path | None = None,
    package_path: list[Path] | None = None,
    xacro_arg: list[str] | None = None,
    limits: Path | None = None,
    force: bool = False,
    *,
    call: Call,
) -> None:
    """Write a complete robot.yaml: what the model says, and what had to be assumed, with its consequence.

    Of a MuJoCo model or xacro file the URDF is written too.
    """
    from excite.robot.inspection.chart import examine_description  # lazy: pinocchio

    source = replace(stated_source(package_path, xacro_arg, limits), srdf=srdf)
    written = excite.write_scaffold(
        file,
        call.out or (file if os.path.isdir(file) else file.parent),
        seed=call.seed,
        overwrite=force,
        source=source,
    )
    chart = examine_description(written.description)
    document = {
        "schema": "excite.init-robot/1",
        "file": "robot.yaml" if call.out else str(written.description),
        "fill_in": [],
        "assumed": [one.to_json() for one in written.assumed],
        "urdf": str(written.urdf) if not call.out else written.urdf.name,
        "notes": list(written.notes),
        "findings": [finding.to_json() for finding in chart.findings],
    }
    lines = [f"wrote {written.description}"]
    if written.urdf != file:
        lines.append(f"wrote {written.urdf}")
    lines += [f"  note: {note}" for note in written.notes]
    lines += [f"  assumed: {one}" for one in written.assumed]
    if chart.findings:
        lines += ["the model itself:", *(f"  {line}" for line in chart.summary().splitlines())]
    call.emit_result("\n".join(lines), document, then=command_line("plan", written.description))


@register_command("check", cluster=True)
def check_motions(
    files: list[str],
    whose: str | None = None,
    robust: bool = False,
    *,
    call: Call,
) -> None:
    """Check motions independently: verdict, margins, first violation with time and place."""
    robot, motions = (files[0], files[1:]) if whose is None else (whose, files)
    if not motions:
        raise typer.BadParameter("name at least one", param_hint="'MOTION…'")
    from excite.motion.collection import motion_paths  # lazy: pinocchio
    from excite.robot.inspection.chart import examine_model  # lazy: pinocchio

    loaded = excite.load_robot(robot)
    with call.requested_workers() as crew, progress_bars() as progress:
        result = excite.check(
            loaded, excite.load_motions(motions, loaded), robust=robust, jobs=crew, progress=progress
        )
    chart = examine_model(loaded)
    result = replace(result, findings=tuple(chart.spoiling))
    if call.out is not None:
        paths = zip(result.verdicts, motion_paths(motions), strict=True)
        verdicts = tuple(replace(one, file=relative_to(call.out, path)) for one, path in paths)
        result = replace(result, verdicts=verdicts, **stated_origin(robot, None, call.out))
        call.write_document(result.to_json(), "check.json")
    then = command_line("rank", robot, *motions) if result.safe else ""
    said = "\n".join(filter(None, (chart.worst_in_words(), result.summary())))
    call.emit_result(said, result.to_json(), then=then)
    if not result.safe:
        raise typer.Exit(EXIT_NEGATIVE)


@register_command("schema")
def print_schema(
    name: str,
) -> None:
    """Print the JSON schema of a file that is written by hand or by excite."""
    print_document(excite.file_schema(name))


@register_command("plan", cluster=True)
def plan_motions(
    robot: str,
    candidates: int | None = None,
    target: list[str] | None = None,
    generator: str | None = None,
    select: str = "best_three",
    budget: float | None = None,
    target_rsd: float = 15.0,
    minutes: float | None = None,
    parameters: str = "",
    robust: bool = False,
    *,
    call: Call,
) -> None:
    """Plan excitation motions: candidates, safety, ranking, choice; writes motions and plan.json."""
    from excite.robot.inspection.chart import examine_model  # lazy: pinocchio

    with (
        call.working_in("plan") as (folder, crew, progress),
        keeping_best(),
    ):
        loaded = excite.load_robot(robot)
        chart = examine_model(loaded)
        plan = excite.plan(
            loaded,
            n_candidates=candidates,
            targets=tuple(target or ()),
            generator=generator,
            selection=select,
            budget_s=budget,
            target_rsd=target_rsd,
            minutes=minutes,
            parameters=tuple(filter(None, parameters.split(","))),
            robust=robust,
            seed=call.seed,
            jobs=crew,
            progress=progress,
        )
        plan.save(folder)
        if not plan.interrupted:
            excite.report(folder)
    call.emit_result(
        "\n".join(filter(None, (chart.worst_in_words(), plan.summary(), f"written to {folder}"))),
        plan.to_json() | {"findings": [finding.to_json() for finding in chart.spoiling]},
        then=command_line("report", folder) if plan.interrupted else command_line("capture", robot, folder),
    )
    if plan.interrupted:
        say_interrupted(f"the best so far is in {folder}")
        raise typer.Exit(exit_code_of_interruption())
    if minutes is not None and plan.needed_min and not plan.reaches:
        # Written all the same, and it says what it would take.
        raise typer.Exit(NoSolutionError.exit_code)


@register_command("rank")
def rank_motions(
    robot: str,
    motions: list[Path],
    *,
    call: Call,
) -> None:
    """Rank motions by condition numbers: full (base columns) and per segment."""
    loaded = excite.load_robot(robot)
    with progress_bars() as progress:
        ranking = excite.rank(loaded, excite.load_motions(motions, loaded), progress=progress)
    call.write_document(ranking.to_json(), "rank.json")
    call.emit_result(
        ranking.summary(),
        ranking.to_json(),
        then=command_line("export", *motions, "--robot", robot, "--format", "csv", "--out", "commands"),
    )


# Of settings that a document's command tells; its seed stands beside it.
_CAMPAIGN_OPTIONS = {
    "n_candidates": "--candidates",
    "target_rsd": "--target-rsd",
    "max_iterations": "--max-iterations",
    "method": "--method",
    "on_robot": "--on-robot",
    "minutes": "--minutes",
}


@register_command("campaign", cluster=True)
def run_campaign(
    context: typer.Context,
    robot: str,
    candidates: int = 140,
    target_rsd: float = 15.0,
    max_iterations: int = 3,
    method: str = DEFAULT_METHOD,
    on_robot: bool = False,
    minutes: float | None = None,
    resume: bool = False,
    *,
    call: Call,
) -> None:
    """Run the whole loop until the targets are met, or say which are not and why."""
    asked: dict[str, Any] = {
        "n_candidates": candidates,
        "target_rsd": target_rsd,
        "max_iterations": max_iterations,
        "method": method,
        "seed": call.seed,
        "on_robot": on_robot,
        "minutes": minutes,
    }
    if resume:
        from excite.campaign.journal import Journal  # lazy: pinocchio

        begun = Journal(call.out or Path("campaign")).settings()
        settings = replace(
            begun, **{name: value for name, value in asked.items() if _is_given(context, name)}
        )
    else:
        settings = excite.CampaignSettings(**asked)
    with (
        call.working_in("campaign") as (folder, crew, progress),
        keeping_best(),
        made_by(_begun_command(robot, settings), excite.__version__, settings.seed),
    ):
        loaded = excite.load_robot(robot)
        result = excite.campaign(
            loaded,
            folder,
            settings,
            resume=resume,
            jobs=crew,
            progress=progress,
        )
        then = command_line("campaign", robot, "--resume", "--out", folder)
        if not result.interrupted:
            excite.report(folder)
            if result.awaits is not None:
                excite.report(result.awaits.parent)
            then = _next_of_page(folder)
    call.emit_result(
        f"{result.summary()}\nwritten to {folder}",
        result.to_json(),
        then=then,
    )
    if result.interrupted:
        say_interrupted(f"what is complete is in {folder}")
        raise typer.Exit(exit_code_of_interruption())
    if not result.targets_met:
        raise typer.Exit(EXIT_NEGATIVE)


def _begun_command(robot: str, settings: excite.CampaignSettings) -> str:
    """The command that the campaign was begun with, whatever it is resumed with."""
    plain = excite.CampaignSettings()
    words: list[object] = []
    for name, option in _CAMPAIGN_OPTIONS.items():
        value = getattr(settings, name)
        if value != getattr(plain, name):
            words += (
                [option] if value is True else [option, f"{value:g}" if isinstance(value, float) else value]
            )
    return command_line("campaign", robot, *words)


def _is_given(context: typer.Context, setting: str) -> bool:
    """Whether a setting was asked for, and is not its option's default."""
    option = setting.removeprefix("n_")
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"


def _next_of_page(folder: Path) -> str:
    """What the page says comes next."""
    from excite.report.conclusions import draw_conclusion  # lazy: numpy
    from excite.report.folder import read_folder  # lazy: numpy

    found = draw_conclusion(read_folder(folder))
    return command_line(*found.command) if found is not None and found.command else ""


@register_command("demo", cluster=True)
def run_demo(
    *,
    call: Call,
) -> None:
    """Plan, check, run and identify on a virtual Unitree G1 with 5 kg added; ends in a report."""
    with call.working_in("demo") as (folder, crew, progress):
        result = excite.demo(folder, seed=call.seed, jobs=crew, progress=progress)
    call.emit_result(
        result.summary(),
        result.to_json(),
        then=command_line("plan", "ROBOT", "--out", "mine"),
    )
