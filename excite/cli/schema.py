"""``excite schema``: the JSON schema of a file."""

from __future__ import annotations

from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, SeedOption
from excite.cli.session.output import print_document

NAME = "schema"


def command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="log, robot, bounds, map, motion; results, all of them, or one: blind, blind_answer, campaign, check, "
            "diagnosis, doctor, export, human, identification, journal, model, plan, rank, refusals, "
            "signals, simulation, truth.",
        ),
    ],
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Print the JSON schema of a file that is written by hand or by excite."""
    print_document(excite.file_schema(name))
