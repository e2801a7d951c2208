"""Words that the shell completes: bundled robots, formats, methods. ``excite --install-completion`` sets it up."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable

from excite.robot.catalogue import bundled_robots

ASKED = "_EXCITE_COMPLETE"
"""What a shell sets that wants a line completed."""


def asked_to_complete() -> bool:
    """Whether a shell, and no person, has called."""
    return ASKED in os.environ


def one_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Completion by names that begin with what was typed; a registry of them is not loaded."""

    # typer goes by the name of the argument.
    def matching(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return matching


def complete_robots(incomplete: str) -> list[str]:
    """Bundled robots; files are the shell's own."""
    return [name for name in bundled_robots() if name.startswith(incomplete)]
