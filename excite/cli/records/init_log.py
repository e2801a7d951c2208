"""``excite init-log``: a commented log.yaml for trial files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, SeedOption
from excite.cli.session.output import command_line, emit_result

NAME = "init-log"


def command(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder with trials whose columns are time, q.JOINT …")
    ],
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a log.yaml that is there already.")
    ] = False,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write a commented log.yaml beside trial files: what they tell, and what a person must fill in."""
    written = excite.write_header(folder, overwrite=force)
    document = {"schema": "excite.init-log/1", "file": str(written.path), "fill_in": list(written.fill_in)}
    lines = [f"wrote {written.path}", *(f"  fill in: {mark}" for mark in written.fill_in)]
    emit_result("\n".join(lines), document, as_json=as_json, then=command_line("doctor", folder))
