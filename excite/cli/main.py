"""The ``excite`` command: its commands put together, errors as one line, exit codes as promised."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from functools import cache
from typing import Annotated, Any, NoReturn

# Many small factorisations: one BLAS thread is faster and repeatable. Set before numpy is imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
# No command draws with OpenGL, and MuJoCo takes a fifth of a second to look for a library of windows.
os.environ.setdefault("MUJOCO_GL", "disable")

import typer  # noqa: E402

import excite  # noqa: E402
from excite.cli import planning, recordings, results  # noqa: E402, F401
from excite.cli.options import (  # noqa: E402
    COMMANDS,
    EXAMPLES,
    HelpfulCommand,
    asked_to_complete,
    typed_command,
    typed_seed,
)
from excite.cli.outcome import (  # noqa: E402
    EXIT_BAD_INPUT,
    EXIT_USAGE,
    answer_interrupted,
    exit_code_of_interruption,
    handle_signals,
    of_error,
    of_system,
    of_unforeseen,
    of_usage,
)
from excite.errors import ExciteError  # noqa: E402
from excite.provenance import made_by  # noqa: E402

# What typer raises for a command line that means nothing; it is click's, which typer may or may not bring along.
_UsageError: Any = typer.BadParameter.__mro__[2]
# 128 and the number of SIGPIPE, as shells have it.
_EXIT_BROKEN_PIPE = 141

app = typer.Typer(
    name="excite",
    help="Design, check, run and evaluate the experiments that identify a robot's dynamics.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

# In the order of their examples, which tell one story.
for _name in EXAMPLES:
    app.command(name=_name, cls=HelpfulCommand)(COMMANDS[_name])


def _print_version(value: bool) -> None:
    if value:
        print(f"excite {excite.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop."),
    ] = False,
) -> None:
    """Design, check, run and evaluate the experiments that identify a robot's dynamics."""


def program() -> NoReturn:
    """The ``excite`` program: the command line in a process of its own, which it ends."""
    # A process that ends soon has little garbage, and a search for it looks at all that was imported: a page of 50
    # motions takes 3.8 s of one processor by Python's own settings, 3.5 s by these, in as much memory.
    gc.set_threshold(50_000, 20, 20)
    for stream in (sys.stdout, sys.stderr):
        # Names of files, and terminals that know no UTF-8, hold what their encoding does not.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    handle_signals()
    try:
        if asked_to_complete():
            app(prog_name="excite")
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    # Threads of native libraries that still wait for work end some one in a dozen processes by an abort, with an exit
    # code that says nothing of what was done, where the interpreter takes itself apart. All else is tidied up as usual.
    atexit._run_exitfuncs()
    sys.stderr.flush()
    os._exit(code)


def main() -> None:
    """Run the command line; however it ends, it says so in one line on stderr and raises SystemExit with its code."""
    try:
        code = _run_command(sys.argv[1:])
        sys.stdout.flush()
    except KeyboardInterrupt:
        code = exit_code_of_interruption()
        answer_interrupted(code)
    except BrokenPipeError:
        # Whoever read the output has gone; the interpreter shall not try to write the rest.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = _EXIT_BROKEN_PIPE
    except OSError as error:
        of_system(error).show(as_json=False)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = EXIT_BAD_INPUT
    sys.exit(code)


@cache
def _click_command() -> Any:
    """All commands as click has them; putting them together takes longer than refusing a file."""
    return typer.main.get_command(app)


def _run_command(arguments: list[str]) -> int:
    """Run one command; its exit code."""
    as_json = "--json" in arguments
    try:
        # Not by calling the app, which ends the process by itself for some errors, with exit codes of its own.
        command = _click_command()
        made = made_by(typed_command(arguments), excite.__version__, typed_seed(arguments))
        with made, command.make_context("excite", arguments) as context:
            command.invoke(context)
        return 0
    except typer.Exit as end:
        return end.exit_code
    except SystemExit as end:
        # How rich ends where whoever read its table has gone.
        if isinstance(end.__context__, BrokenPipeError):
            raise BrokenPipeError from end
        raise
    except ExciteError as error:
        failure = of_error(error)
        # One document on stdout, not two.
        as_json = as_json and not getattr(error, "shown", False)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return EXIT_USAGE
        failure = of_usage(error)
    except OSError as error:
        if error.filename is None:
            raise
        failure = of_system(error)
    except Exception as error:  # noqa: BLE001  (no traceback is a user's)
        failure = of_unforeseen(error, arguments)
    failure.show(as_json=as_json)
    return failure.code


if __name__ == "__main__":
    program()
