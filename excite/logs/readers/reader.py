"""What every format of trial files offers: named columns of numbers, read and written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from excite.errors import LogError
from excite.robot.robot import Array


class TrialReader(ABC):
    """A file format for trials.

    Attributes:
        name: name of the format.
        suffixes: file name endings that it answers to, lower case, with the dot.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def read(self, path: Path) -> dict[str, Array]:
        """Read all columns, ``(n,)`` each, as they stand in the file.

        Raises:
            LogError: the file is missing, or is no such file.
        """

    @abstractmethod
    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """Write columns, ``(n,)`` each, to ``path``."""


def unreadable(path: Path, error: Exception) -> LogError:
    """The error for a file that its library cannot read, in one line."""
    if isinstance(error, FileNotFoundError) or not path.exists():
        return LogError("no such file", source=path, remedy="check the name in log.yaml")
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(f"cannot be read ({text[:160]})", source=path, remedy="check that the file is complete")
