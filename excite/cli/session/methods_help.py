"""Help of the commands that identify: the methods, a line each, from the registry."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

import excite

METHOD_HELP = "Estimator, one of those below."


class MethodsCommand(TyperCommand):
    """A command whose help ends with the methods of identification and when to take which.

    They are asked for only when this help is shown: the registry loads every estimator.
    """

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the methods after the options."""
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
