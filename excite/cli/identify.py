"""``excite identify``: inertial parameters from logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.options import DEFAULT_JOBS, JobsOption, JsonOption, OutOption, RobotArgument, SeedOption
from excite.cli.output import emit
from excite.json_document import write_json

NAME = "identify"


def command(
    robot: RobotArgument,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Log folders (excite.log/1).")],
    method: Annotated[str, typer.Option("--method", help="Estimator: ls, wls, qp, …")] = "qp",
    total_mass: Annotated[
        float | None, typer.Option("--total-mass", min=0.0, help="Weighed mass of the robot [kg].")
    ] = None,
    cutoff_hz: Annotated[
        float | None,
        typer.Option("--cutoff", min=0.0, help="Cut-off of the zero-phase low-pass on all signals [Hz]."),
    ] = None,
    drives: Annotated[
        bool, typer.Option("--drives", help="Write identified friction into the model files too.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write a URDF even of parameters that no rigid body has.")
    ] = False,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Identify the inertial parameters: values, relative standard deviations, fit, validation.

    With --out also the robot's URDF and a MuJoCo model with the identified inertials, and differences.csv.
    """
    loaded = excite.load_robot(robot)
    result = excite.identify(
        loaded,
        excite.join_logs([excite.load_log(log, loaded) for log in logs]),
        method,
        settings=excite.EstimatorSettings(total_mass=total_mass),
        problem_settings=excite.ProblemSettings(cutoff_hz=cutoff_hz),
    )
    document, summary = result.to_json(), result.summary()
    if out is not None:
        models = excite.write_models(loaded, result, out, drives=drives, force=force)
        document["models"] = models.to_json()
        summary = f"{summary}\n\n{models.summary()}"
        write_json(document, out / "identification.json")
    emit(summary, document, as_json=as_json)
