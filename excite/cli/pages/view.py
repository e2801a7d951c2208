"""``excite view``: a motion, a plan, a log or a diagnosis, moving in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import emit_result

NAME = "view"


def command(
    thing: Annotated[
        Path,
        typer.Argument(
            metavar="THING", help="A motion file, or the folder of motions, a plan, a log or a diagnosis."
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot", metavar="ROBOT", help="The robot, where the files do not say or it lies elsewhere."
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE.html",
            help="Write it as a page that needs no network, and serve nothing; in --out where that is given.",
        ),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Port to serve at.")] = 8080,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Watch it move, with the signals of a joint and its residuals beside it."""
    from excite.report.view import read_thing, record_page, serve  # lazy: pinocchio

    shown = read_thing(thing, robot)
    if record is not None:
        path = record_page(shown, record if out is None else out / record)
        document = {"schema": "excite.view/1", "file": str(record), "motions": len(shown.clips)}
        emit_result(f"wrote {path}", document, as_json=as_json, then="open it in a browser")
        return

    def ready(address: str) -> None:
        document = {"schema": "excite.view/1", "address": address, "motions": len(shown.clips)}
        emit_result(f"{shown.title}\nopen {address} in a browser; Ctrl-C ends it", document, as_json=as_json)

    serve(shown, port, ready)
