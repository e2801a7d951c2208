"""``excite export``: files for robot controllers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.options import DEFAULT_JOBS, JobsOption, JsonOption, MotionArgument, OutOption, SeedOption
from excite.cli.output import emit

NAME = "export"


def command(
    motions: MotionArgument,
    format_name: Annotated[str, typer.Option("--format", help="csv, npz or ros2 (JointTrajectory in MCAP).")],
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate", min=1e-3, help="Samples per second; the motion's own where left out."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Robot, where the motion file's metadata do not name a bundled one."),
    ] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Write motions in the format of a controller."""
    written = excite.export_motions(motions, format_name, out=out or Path(), rate_hz=rate_hz, robot=robot)
    document = {
        "schema": "excite.export/1",
        "format": format_name,
        "files": [str(path.relative_to(out) if out else path) for path in written],
    }
    emit("\n".join(f"wrote {path}" for path in written), document, as_json=as_json)
