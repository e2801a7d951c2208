"""``excite plan``: generate, filter, rank, choose."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import excite
from excite.campaign.searches import SEARCHES
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
from excite.cli.session.output import command_line, emit_result, progress_bars
from excite.errors import NoSolutionError
from excite.folder_lock import claim_folder
from excite.motion.generators.registry import GENERATORS

if TYPE_CHECKING:
    from excite.campaign.optimised_series import SeriesSettings

NAME = "plan"


def command(
    robot: RobotArgument,
    candidates: Annotated[
        int | None,
        typer.Option(
            "--candidates",
            min=1,
            help="Candidate motions to generate; 140 if left out, and twice as many more while fewer than three "
            "motions come of them.",
        ),
    ] = None,
    target: Annotated[
        list[str] | None, typer.Option("--joint", help="Aim at this joint (may be repeated).")
    ] = None,
    generator: Annotated[
        str | None,
        typer.Option(
            "--generator",
            help=f"Use this generator alone: {', '.join([*GENERATORS, *SEARCHES])}. "
            "Of optimised_fourier, --candidates is the number of starts, of seconds each; of gradient, that of "
            "motions to design, a second each.",
            autocompletion=one_of([*GENERATORS, *SEARCHES]),
        ),
    ] = None,
    select: Annotated[
        str,
        typer.Option(
            "--select",
            help="How motions are chosen: best_three of every DoF or, within --budget, by log_det, predicted rsd "
            "or targets, or segments, the condition numbers of all of them.",
        ),
    ] = "best_three",
    budget: Annotated[
        float | None,
        typer.Option(
            "--budget", help="Seconds that the choice stays within; as many as best_three takes, if left out."
        ),
    ] = None,
    target_rsd: Annotated[
        float,
        typer.Option(
            "--target-rsd",
            min=0.0,
            help="Relative standard deviation [percent] that the plan says how much motion it takes to reach.",
        ),
    ] = 15.0,
    minutes: Annotated[
        float | None,
        typer.Option(
            "--minutes",
            help="Minutes at the robot: motions are chosen within them for --targets, of an arm among those designed "
            "by gradients, and the plan says what they reach.",
        ),
    ] = None,
    parameters: Annotated[
        str,
        typer.Option(
            "--targets",
            help="What --minutes are for, such as elbow_joint:friction,forearm_link:com (friction, mass, com, "
            "inertia); all parameters, if left out.",
        ),
    ] = "",
    criterion: Annotated[
        str | None,
        typer.Option(
            "--criterion", help="What optimised_fourier makes small: condition, log_det or largest_rsd."
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option("--period", help="Period of optimised_fourier [s], else as joints need.")
    ] = None,
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            help="Keep torque, balance and friction within limits for every robot within the uncertainty that "
            "robot.yaml states (mass ± 10 %, centre of mass ± 1 cm, inertia ± 20 % of each body if it states none).",
        ),
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Plan excitation motions: candidates, safety, ranking, choice; writes motions and plan.json."""
    from excite.robot.inspection.chart import examine_model  # lazy: pinocchio

    with (
        claim_folder(out or Path("plan")) as folder,
        requested_workers(jobs, cluster) as crew,
        progress_bars() as progress,
        keeping_best(),
    ):
        loaded = excite.load_robot(robot)
        chart = examine_model(loaded)
        with refusals_shown(loaded, folder):
            plan = excite.plan(
                loaded,
                n_candidates=candidates,
                targets=tuple(target or ()),
                generator=generator,
                series=_series_settings(criterion, period),
                selection=select,
                budget_s=budget,
                target_rsd=target_rsd,
                minutes=minutes,
                parameters=tuple(filter(None, parameters.split(","))),
                robust=robust,
                seed=seed,
                jobs=crew,
                progress=progress,
            )
        plan.save(folder)
        if not plan.interrupted:
            excite.report(folder)
    emit_result(
        "\n".join(filter(None, (chart.worst_in_words(), plan.summary(), f"written to {folder}"))),
        plan.to_json() | {"findings": [finding.to_json() for finding in chart.spoiling]},
        as_json=as_json,
        then=command_line("report", folder) if plan.interrupted else command_line("capture", robot, folder),
    )
    if plan.interrupted:
        say_interrupted(f"the best so far is in {folder}")
        raise typer.Exit(exit_code_of_interruption())
    if minutes is not None and plan.needed_min and not plan.reaches:
        # Written all the same, and it says what it would take.
        raise typer.Exit(NoSolutionError.exit_code)


def _series_settings(criterion: str | None, period: float | None) -> SeriesSettings | None:
    if criterion is None and period is None:
        return None
    default = excite.SeriesSettings()
    return excite.SeriesSettings(criterion or default.criterion, period)
