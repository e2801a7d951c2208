"""``excite check``: the independent verdict on motions."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

import excite
from excite.cli.session.options import (
    ClusterOption,
    JobsOption,
    JsonOption,
    OutOption,
    SeedOption,
    requested_workers,
)
from excite.cli.session.output import (
    EXIT_NEGATIVE,
    command_line,
    emit_result,
    progress_bars,
    relative_to,
    stated_origin,
)
from excite.results import write_json

NAME = "check"


def command(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT MOTION…",
            help="Robot (a bundled one or a path to its robot.yaml); then motions: files of any format that export "
            "writes, tables with a time and a column a joint, or folders of them.",
        ),
    ],
    whose: Annotated[
        str | None,
        typer.Option("--robot", metavar="ROBOT", help="The robot; all arguments are motions then."),
    ] = None,
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            help="Call a motion safe only if it is so for every robot within the uncertainty that robot.yaml states "
            "(mass ± 10 %, centre of mass ± 1 cm, inertia ± 20 % of each body if it states none).",
        ),
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Check motions independently: verdict, margins, first violation with time and place."""
    robot, motions = (files[0], files[1:]) if whose is None else (whose, files)
    if not motions:
        raise typer.BadParameter("name at least one", param_hint="'MOTION…'")
    from excite.motion.collection import motion_paths  # lazy: pinocchio
    from excite.robot.inspection.chart import examine_model  # lazy: pinocchio

    loaded = excite.load_robot(robot)
    with requested_workers(jobs, cluster) as crew, progress_bars() as progress:
        result = excite.check(
            loaded, excite.load_motions(motions, loaded), robust=robust, jobs=crew, progress=progress
        )
    chart = examine_model(loaded)
    result = replace(result, findings=tuple(chart.spoiling))
    if out is not None:
        paths = zip(result.verdicts, motion_paths(motions), strict=True)
        verdicts = tuple(replace(one, file=relative_to(out, path)) for one, path in paths)
        result = replace(result, verdicts=verdicts, **stated_origin(robot, None, out))
        write_json(result.to_json(), out / "check.json")
    then = command_line("rank", robot, *motions) if result.safe else ""
    said = "\n".join(filter(None, (chart.worst_in_words(), result.summary())))
    emit_result(said, result.to_json(), as_json=as_json, then=then)
    if not result.safe:
        raise typer.Exit(EXIT_NEGATIVE)
