"""What every format of trial files offers: named columns of numbers, read and written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import LogError
from excite.reading.file import check_file

if TYPE_CHECKING:
    # A process that reads one file shall not wait for the robots' library.
    from excite.arrays import Array

# An hour at 1 kHz of an arm with 55 channels: 1.6 GB as numbers, of which a few copies fit into a usual memory.
MAX_NUMBERS = 200_000_000
# A humanoid with hands has 500 columns, an array of tactile sensors some thousand.
MAX_COLUMNS = 20_000
# Ten bytes a number, as text has them.
MAX_TRIAL_BYTES = 10 * MAX_NUMBERS


class TrialReader(ABC):
    """A file format for trials.

    Attributes:
        name: name of the format.
        suffixes: file name endings that it answers to, lower case, with the dot.
        own_process: function that reads a list of files in a process of its own, ``package.module:name``, for formats
            whose library damaged files make crash or hang; None for the others.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    own_process: ClassVar[str | None] = None

    def read(self, path: Path) -> dict[str, Array]:
        """Read all columns, ``(n,)`` each, as they stand in the file; those that hold no numbers come empty.

        Raises:
            LogError: the file is missing, is no such file, or holds more than can be read.
        """
        return self._columns(check_file(path, limit=MAX_TRIAL_BYTES, error=LogError))

    @abstractmethod
    def _columns(self, path: Path) -> dict[str, Array]:
        """What :meth:`read` returns, of a regular file of bounded size."""

    @abstractmethod
    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """Write columns, ``(n,)`` each, to ``path``."""


def check_size(numbers: int, columns: int, path: Path) -> None:
    """Refuse a file by what it says that it holds, before any of it is read; raises LogError."""
    if columns > MAX_COLUMNS:
        raise LogError(
            f"has {columns} columns, more than the {MAX_COLUMNS} that are read",
            source=path,
            remedy="leave out what is no channel of the robot",
        )
    if numbers > MAX_NUMBERS:
        raise LogError(
            f"holds {numbers} numbers, more than the {MAX_NUMBERS} that are read",
            source=path,
            remedy="split the recording",
        )


def no_numbers(dtype: np.dtype[Any]) -> NDArray[Any]:
    """What stands for a column that holds words, dates or anything else that is no number: its type, no rows."""
    return np.empty(0, dtype)


def unreadable(path: Path, error: Exception) -> LogError:
    """The error for a file that its library cannot read, in one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(f"cannot be read ({text[:160]})", source=path, remedy="check that the file is complete")
