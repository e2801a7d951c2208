"""``excite identify-load``: what hangs at the last link, from logs without and with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, RobotArgument, SeedOption
from excite.cli.session.output import command_line, emit_result
from excite.errors import InputError
from excite.results import write_json

NAME = "identify-load"


def command(
    robot: RobotArgument,
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
    cutoff_hz: Annotated[
        float | None,
        typer.Option("--cutoff", min=0.0, help="Cut-off of the zero-phase low-pass on all signals [Hz]."),
    ] = None,
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
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
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
        if out is not None:
            payload.write(out)
    if out is not None:
        write_json(document, out / "load.json")
    emit_result(
        summary,
        document,
        as_json=as_json,
        then=command_line("diagnose", loaded, "--out", "diagnosis"),
    )
