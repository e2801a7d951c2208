"""``excite init-robot``: a commented ``robot.yaml`` for a robot of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import emit

NAME = "init-robot"


def command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="URDF of the robot, or its MuJoCo model (MJCF).")
    ],
    out: OutOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a robot.yaml that is there already.")
    ] = False,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write a commented robot.yaml: what could be derived, and what a person must fill in.

    Of a MuJoCo model the URDF and its meshes are written too.
    """
    written = excite.write_scaffold(file, out or file.parent, seed=seed, overwrite=force)
    document = {
        "schema": "excite.init-robot/1",
        "file": "robot.yaml" if out else str(written.description),
        "fill_in": list(written.fill_in),
        "urdf": str(written.urdf) if not out else written.urdf.name,
        "notes": list(written.notes),
    }
    lines = [f"wrote {written.description}"]
    if written.urdf != file:
        lines.append(f"wrote {written.urdf}")
    lines += [f"  note: {note}" for note in written.notes]
    lines += [f"  fill in: {mark}" for mark in written.fill_in]
    lines.append(f"then: excite plan {written.description}")
    emit("\n".join(lines), document, as_json=as_json)
