"""Help of the commands that identify names every method, and only that help loads the estimators."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import typer

from excite.cli.main import app
from excite.identification.estimators.registry import DEFAULT_METHOD, method_summaries


def help_of(name: str) -> str:
    command = typer.main.get_command(app).commands[name]
    with command.make_context(name, [], resilient_parsing=True) as context:
        return command.get_help(context)


def test_help_says_what_is_to_be_typed_not_of_which_type_it_will_be() -> None:
    assert "--cutoff NUMBER" in help_of("identify") and "--static PATH" in help_of("human")
    commands = typer.main.get_command(app).commands
    for command, inner in commands.items():
        with inner.make_context(f"excite {command}", [], resilient_parsing=True) as context:
            options = inner.get_help(context).partition("Examples:")[0]
        assert not re.search(r"<[a-z][^=]*>", options), command


@pytest.mark.parametrize("name", ["identify", "campaign"])
def test_every_method_is_named_with_what_it_is_for(name: str) -> None:
    table = " " + " ".join(help_of(name).split("Methods:")[1].split())
    for item in method_summaries():
        assert f"{item.title}. For {item.use}." in table
    assert f" {DEFAULT_METHOD} (default) " in table


def test_other_help_loads_no_estimator() -> None:
    code = (
        "import sys\nfrom excite.cli import main\nsys.argv = ['excite', '--help']\n"
        "try:\n    main.main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'excite.identification.estimators.estimator', 'pinocchio', 'numpy', 'pydantic'}\n"
        "sys.exit(sorted(heavy & {*sys.modules}) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "identify" in done.stdout, done.stderr
