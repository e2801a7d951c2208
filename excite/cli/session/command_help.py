"""Help of the commands: it ends with examples, and of those that identify it names the methods before them."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

import excite
from excite.cli.session.examples import EXAMPLES

METHOD_HELP = "Estimator, one of those below."


class HelpfulCommand(TyperCommand):
    """A command whose help ends with examples."""

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
