"""``excite init-robot``: a commented ``robot.yaml`` for a robot of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.atomic import write_text
from excite.cli.options import DEFAULT_JOBS, JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.output import emit
from excite.errors import InputError

NAME = "init-robot"


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="URDF of the robot.")],
    out: OutOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a robot.yaml that is there already.")
    ] = False,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Write a commented robot.yaml: what could be derived, and what a person must fill in."""
    target = (out or file.parent) / "robot.yaml"
    if target.exists() and not force:
        raise InputError("exists already", source=target, remedy="give --force to overwrite it, or --out DIR")
    text = excite.scaffold_description(file, target.parent, seed=seed)
    write_text(target, text)
    marks = [line.partition("FILL IN:")[2].strip() for line in text.splitlines() if "FILL IN:" in line]
    document = {
        "schema": "excite.init-robot/1",
        "file": "robot.yaml" if out else str(target),
        "fill_in": marks,
    }
    lines = [f"wrote {target}", *(f"  fill in: {mark}" for mark in marks), f"then: excite plan {target}"]
    emit("\n".join(lines), document, as_json=as_json)
