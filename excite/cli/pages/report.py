"""``excite report``: one self-contained HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import emit_result

NAME = "report"


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that another command wrote.")],
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Write report.html from what a folder holds."""
    path = excite.report(folder, out=out)
    document = {"schema": "excite.report/1", "file": str(path.relative_to(out) if out else path)}
    emit_result(f"wrote {path}", document, as_json=as_json, then="open it in a browser")
