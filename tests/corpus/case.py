"""One bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Case:
    """A bad input and what is said of it.

    Attributes:
        family: kind of fault.
        name: short name, unique in the family.
        build: makes files in an empty folder and returns the arguments of the command line.
        line: pattern that the one line on stderr has to match.
    """

    family: str
    name: str
    build: Callable[[Path], list[str]]
    line: str
