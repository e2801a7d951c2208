"""``python -m benchmarks.blind``: errors, exit codes and interruption are those of the program, whose command it is."""

import sys

from benchmarks.blind.command import app as command
from excite.cli.main import app, program

if __name__ == "__main__":
    app.add_typer(command, name="blind")
    sys.argv.insert(1, "blind")
    program()
