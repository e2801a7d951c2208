"""Help of the commands: it ends with examples, and of those that identify it names the methods before them."""

from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

import excite
from excite.cli.session.examples import EXAMPLES

METHOD_HELP = "Estimator, one of those below."


# What typer calls a type, such as <list[Path]> or <int range>, and what is to be typed.
_TYPE = re.compile(r"<(?:list\[)?(\w+)(?:\])?(?: range)?>")
_CHOICE = re.compile(r"<([^<>]*\|[^<>]*)>")
_TYPED = {"int": "NUMBER", "float": "NUMBER", "str": "TEXT", "path": "PATH", "file": "PATH"}


def _in_words(left: str) -> str:
    """The left column of a row of help: what is to be typed, not of which type of Python's it will be."""
    if not left.startswith("-"):
        # The name of an argument says what it is.
        return _TYPE.sub("", left).rstrip()
    return _CHOICE.sub(r"[\1]", _TYPE.sub(lambda found: _TYPED.get(found[1].lower(), found[0]), left))


class HelpfulCommand(TyperCommand):
    """A command whose help says what is to be typed, and ends with examples."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        write = formatter.write_dl

        def in_words(rows: Any, *arguments: Any, **options: Any) -> None:
            write([(_in_words(left), right) for left, right in rows], *arguments, **options)

        formatter.write_dl = in_words
        super().format_options(ctx, formatter)
        formatter.write_dl = write

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples after the options."""
        # The name without the program's, which may have been started as a module.
        name = ctx.command_path.split(" ", 1)[-1]
        with formatter.section("Examples"):
            for line, meaning in EXAMPLES[name]:
                # Not wrapped: a line is to be copied as it stands.
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")
                formatter.indent()
                formatter.indent()
                formatter.write_text(meaning)
                formatter.dedent()
                formatter.dedent()


class MethodsCommand(HelpfulCommand):
    """A command that identifies: its help names the methods and when to take which.

    They are asked for only when this help is shown: the registry loads every estimator.
    """

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the methods after the options, and then the examples."""
        default = next((item.default for item in self.params if item.name == "method"), None)
        rows = [
            (
                f"{item.name} (default)" if item.name == default else item.name,
                f"{item.title}. For {item.use}.",
            )
            for item in excite.method_summaries()
        ]
        with formatter.section("Methods"):
            formatter.write_dl(rows)
        super().format_epilog(ctx, formatter)
