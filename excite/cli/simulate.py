"""``excite simulate``: run motions on the MuJoCo virtual robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import (
    ClusterOption,
    JobsOption,
    JsonOption,
    MotionArgument,
    OutOption,
    RobotArgument,
    SeedOption,
    one_of,
    requested_workers,
)
from excite.cli.session.output import EXIT_NEGATIVE, command_line, emit_result, progress_bars
from excite.folder_lock import claim_folder
from excite.logs.vocabulary import EFFECTS

NAME = "simulate"


def command(
    robot: RobotArgument,
    motions: MotionArgument,
    inject: Annotated[
        list[str] | None,
        typer.Option(
            "--inject",
            metavar="EFFECT[:LOCATION[:VALUE]]",
            help=f"An effect that the nominal model lacks (may be repeated): {', '.join(EFFECTS)}.",
            autocompletion=one_of(EFFECTS),
        ),
    ] = None,
    nominal: Annotated[
        bool, typer.Option("--nominal", help="Give the virtual robot the nominal inertial parameters.")
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Run motions on a virtual robot whose true inertials differ from the model; writes a log folder."""
    from excite.campaign.experiment import planned_roles  # lazy: pydantic
    from excite.logs.files import check_replaceable  # lazy: pinocchio

    check_replaceable(out or Path("log"))
    loaded = excite.load_robot(robot)
    with (
        claim_folder(out or Path("log")) as folder,
        requested_workers(jobs, cluster) as crew,
        progress_bars() as progress,
    ):
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
            seed=seed,
            jobs=crew,
            progress=progress,
        )
        experiment.save(folder)
    identify = command_line("identify", robot, folder, "--out", "result")
    # What stands on feet that measure nothing is identified, and not diagnosed.
    told = not loaded.floating or loaded.description.sensors.wrench
    then = command_line("diagnose", folder, "--out", "diagnosis") if inject and told else identify
    emit_result(
        f"{experiment.summary()}\nwritten to {folder}",
        experiment.to_json(),
        as_json=as_json,
        then=then,
    )
    if experiment.fell:
        raise typer.Exit(EXIT_NEGATIVE)
