"""The page of commands: the help of every one, as it is printed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import typer


def commands_page() -> str:
    """Markdown with a section for every command."""
    # Help is wrapped to the terminal; the page has a width of its own.
    os.environ["COLUMNS"] = "100"
    from excite.cli.main import app

    parts = ["# Commands\n", "What `excite COMMAND --help` prints.\n"]
    for name, command, context in walk(typer.main.get_command(app), "excite", None):
        parts += [f"## {name}\n", "```text", command.get_help(context), "```\n"]
    return "\n".join(parts)


def walk(command: Any, name: str, parent: Any) -> Iterator[tuple[str, Any, Any]]:
    """Every command that does something, by its full name, with the context that its help is asked in."""
    # A context is made without reading arguments: what is required is then not missed.
    context = type(command).context_class(command, info_name=name.rsplit(" ", 1)[-1], parent=parent)
    commands = getattr(command, "commands", None)
    if commands is None:
        yield name, command, context
        return
    for key, inner in commands.items():
        yield from walk(inner, f"{name} {key}", context)
