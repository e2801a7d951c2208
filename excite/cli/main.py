"""The ``excite`` command: one module a command, errors as one line, exit codes as promised."""

from __future__ import annotations

import os
import sys
from typing import Annotated

# Many small factorisations: one BLAS thread is faster and repeatable. Set before numpy is imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import typer  # noqa: E402

import excite  # noqa: E402
from excite.cli import (  # noqa: E402
    blind,
    campaign,
    check,
    demo,
    diagnose,
    effects,
    export,
    human,
    identify,
    init_robot,
    plan,
    rank,
    report,
    robots,
    simulate,
)
from excite.errors import ExciteError  # noqa: E402

app = typer.Typer(
    name="excite",
    help="Design, check, run and evaluate the experiments that identify a robot's dynamics.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

for _module in (
    robots,
    init_robot,
    plan,
    check,
    rank,
    export,
    simulate,
    identify,
    diagnose,
    effects,
    human,
    campaign,
    report,
    demo,
):
    app.command(name=_module.NAME)(_module.command)


app.add_typer(blind.app, name=blind.NAME)


def _version(value: bool) -> None:
    if value:
        print(f"excite {excite.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Design, check, run and evaluate the experiments that identify a robot's dynamics."""


def main() -> None:
    """Run the command line; errors that excite knows become one line on stderr and an exit code."""
    try:
        app()
    except ExciteError as error:
        line = " ".join(str(error).split())
        print(f"excite: {line}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("excite: interrupted", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
