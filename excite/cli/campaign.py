"""``excite campaign``: plan, run, identify, repeat until the parameters are certain enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

import excite
from excite.cli.session.command_help import METHOD_HELP
from excite.cli.session.interruption import exit_code_of_interruption, keeping_best, say_interrupted
from excite.cli.session.options import (
    ClusterOption,
    JobsOption,
    JsonOption,
    OutOption,
    RobotArgument,
    SeedOption,
    one_of,
    requested_workers,
)
from excite.cli.session.outcome import refusals_shown
from excite.cli.session.output import EXIT_NEGATIVE, command_line, emit_result, progress_bars
from excite.folder_lock import claim_folder
from excite.identification.estimators.registry import DEFAULT_METHOD, ESTIMATORS
from excite.provenance import made_by

NAME = "campaign"

# Of settings that a document's command tells; its seed stands beside it.
_OPTIONS = {
    "n_candidates": "--candidates",
    "target_rsd": "--target-rsd",
    "max_iterations": "--max-iterations",
    "method": "--method",
    "on_robot": "--on-robot",
    "minutes": "--minutes",
}


def command(
    context: typer.Context,
    robot: RobotArgument,
    candidates: Annotated[
        int, typer.Option("--candidates", min=1, help="Candidate motions in each iteration.")
    ] = 140,
    target_rsd: Annotated[
        float, typer.Option("--target-rsd", min=0.0, help="Relative standard deviation to reach [percent].")
    ] = 15.0,
    max_iterations: Annotated[int, typer.Option("--max-iterations", min=1, help="Iterations at most.")] = 3,
    method: Annotated[
        str, typer.Option("--method", help=METHOD_HELP, autocompletion=one_of(ESTIMATORS))
    ] = DEFAULT_METHOD,
    on_robot: Annotated[
        bool,
        typer.Option(
            "--on-robot", help="Stop after each plan so that the motions can be recorded on the real robot."
        ),
    ] = False,
    minutes: Annotated[
        float | None,
        typer.Option(
            "--minutes",
            help="Minutes of motion in each iteration: what the first is expected to reach is aimed at, else all "
            "essential parameters.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the campaign that --out holds, by its options.")
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Run the whole loop until the targets are met, or say which are not and why."""
    asked: dict[str, Any] = {
        "n_candidates": candidates,
        "target_rsd": target_rsd,
        "max_iterations": max_iterations,
        "method": method,
        "seed": seed,
        "on_robot": on_robot,
        "minutes": minutes,
    }
    if resume:
        from excite.campaign.journal import Journal  # lazy: pinocchio

        begun = Journal(out or Path("campaign")).settings()
        settings = replace(
            begun, **{name: value for name, value in asked.items() if _is_given(context, name)}
        )
    else:
        settings = excite.CampaignSettings(**asked)
    with (
        claim_folder(out or Path("campaign")) as folder,
        requested_workers(jobs, cluster) as crew,
        progress_bars() as progress,
        keeping_best(),
        made_by(_begun_command(robot, settings), excite.__version__, settings.seed),
    ):
        loaded = excite.load_robot(robot)
        with refusals_shown(loaded, folder):
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
    emit_result(
        f"{result.summary()}\nwritten to {folder}",
        result.to_json(),
        as_json=as_json,
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
    for name, option in _OPTIONS.items():
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
