"""``excite init-robot``: a commented ``robot.yaml`` for a robot of one's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import (
    JobsOption,
    JsonOption,
    LimitsOption,
    OutOption,
    PackagePathOption,
    SeedOption,
    XacroArgOption,
    stated_source,
)
from excite.cli.session.output import command_line, emit_result

NAME = "init-robot"


def command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="URDF or xacro of the robot, or its MuJoCo model (MJCF).")
    ],
    srdf: Annotated[
        Path | None, typer.Option("--srdf", help="Pairs of links that may touch, from MoveIt's file.")
    ] = None,
    package_path: PackagePathOption = None,
    xacro_arg: XacroArgOption = None,
    limits: LimitsOption = None,
    out: OutOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a robot.yaml that is there already.")
    ] = False,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write a complete robot.yaml: what the model says, and what had to be assumed, with its consequence.

    Of a MuJoCo model or xacro file the URDF is written too.
    """
    from excite.robot.inspection.chart import examine_description  # lazy: pinocchio

    source = replace(stated_source(package_path, xacro_arg, limits), srdf=srdf)
    written = excite.write_scaffold(file, out or file.parent, seed=seed, overwrite=force, source=source)
    chart = examine_description(written.description)
    document = {
        "schema": "excite.init-robot/1",
        "file": "robot.yaml" if out else str(written.description),
        "fill_in": [],
        "assumed": [one.to_json() for one in written.assumed],
        "urdf": str(written.urdf) if not out else written.urdf.name,
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
    emit_result("\n".join(lines), document, as_json=as_json, then=command_line("plan", written.description))
