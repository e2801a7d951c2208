"""What one case of the corpus is: files that somebody may hand over, and the line that answers them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Case:
    """A mistake, and what the command line says of it.

    Attributes:
        family: what kind of mistake it is.
        name: which one, unique within the family.
        build: makes the files in an empty folder and returns the arguments of the command.
        line: pattern that the one line on stderr has to match.
    """

    family: str
    name: str
    build: Callable[[Path], list[str]]
    line: str
